"""The core with AVX2 and without: a switch for tests, and results that agree to rounding."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ambid import _core
from ambid.demo import DATA
from ambid.identification import identify
from ambid.model import Model
from ambid.record import Record
from ambid.rig import Rig

SWITCH = "AMBID_SIMD"
SAMPLES = 400


def results() -> dict:
    """Which instructions the core of this process runs with, a response with its derivatives, and a fit."""
    rig = Rig.load(DATA / "rig.toml")
    record = Record.load(DATA / "prbs.mat", rig)
    model = Model(rig)
    y, slopes = model.loop.sensitivity(model.theta, record.i_e[:SAMPLES], range(len(model.names)))
    found = identify(rig, record)
    return {
        "instructions": _core.instructions(),
        "y": y.tolist(),
        "slopes": slopes.tolist(),
        "status": found.status,
        "misfit": found.misfit,
        "theta": found.model.theta.tolist(),
        "errors": [p.std_error for p in found.parameters.values()],
    }


def of_process(value: str) -> dict:
    """The results of a process of its own, in which the switch has this value."""
    program = "import json; from test_instructions import results; print(json.dumps(results()))"
    own = [str(Path(__file__).parent), *sys.path]
    environment = os.environ | {SWITCH: value, "PYTHONPATH": os.pathsep.join(own)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def plain() -> dict:
    return of_process("none")


@pytest.fixture(scope="module")
def usual() -> dict:
    return results() if SWITCH not in os.environ else of_process("")


def test_the_switch_turns_them_off(plain, usual):
    assert plain["instructions"] == "baseline"
    assert usual["instructions"] in ("baseline", "avx2")


def test_responses_and_derivatives_agree_to_rounding(plain, usual):
    for name in ("y", "slopes"):
        fast, slow = np.array(usual[name]), np.array(plain[name])
        size = np.abs(slow).max(axis=0)
        assert np.all(np.abs(fast - slow).max(axis=0) <= 1e-12 * size)


def test_fits_agree_far_within_their_standard_errors(plain, usual):
    assert usual["status"] == plain["status"]
    assert usual["misfit"] == pytest.approx(plain["misfit"], rel=1e-9)
    off = (np.array(usual["theta"]) - plain["theta"]) / plain["errors"]
    assert np.abs(off).max() < 1e-5
