"""Where tests find what they read."""

import os
from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent
BENCH = TESTS / "data" / "bench_rig.toml"
"""Rig file of the two-bearing bench of the independent simulator."""
LEVITATOR = TESTS / "data" / "levitator.toml"
"""Rig file of a mass on one axis, for what four axes would only make slow."""
SHARED = Path(os.environ.get("AMBID_SHARED", ROOT.parent / "shared"))
"""Measured cases, a campaign and real hardware, too large for the project; without them their tests are skipped."""
