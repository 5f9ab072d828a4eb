"""One job that nobody stops, which all others are held against."""

from pathlib import Path
from typing import NamedTuple

import pytest

from ambid.monte_carlo import procedure, run_monte_carlo
from monte_carlo.planned import CHUNK, RUNS, content, plan


class Whole(NamedTuple):
    """Its result, and the folder of its parts."""

    rows: list
    folder: Path
    parts: dict


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """What one thread leaves of `RUNS` runs in parts of `CHUNK`."""
    folder = tmp_path_factory.mktemp("whole") / "runs.parquet"
    pytest.importorskip("pyarrow")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(procedure, "CHUNK", CHUNK)
        rows = run_monte_carlo(plan(), RUNS, out=folder).rows
    return Whole(rows, folder, content(folder))
