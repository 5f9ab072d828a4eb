"""Every example runs by itself, says what is true, and leaves nothing behind."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from ambid.demo import DATA
from places import ROOT

FOLDER = ROOT / "python" / "examples"
NEEDS = {"controller_from_control": "control"}


def numbers(said: str, words: str) -> list[float]:
    """The numbers that stand in the text where each # is."""
    pattern = re.sub(r"\s+", r"\\s+", re.escape(words).replace(r"\#", r"([-+.\de]+)").replace(r"\ ", " "))
    found = re.search(pattern, said)
    assert found, f"{words!r} is not in:\n{said}"
    return [float(number) for number in found.groups()]


def controller_from_control(said, truth):
    for words in ("pid: stable", "digital: stable", "inputs i_e_A_zeta"):
        assert words in said
    (peak,) = numbers(said, "peak sensitivity #")
    assert f"zone {'A' if peak < 3.0 else 'B'} of ISO 14839-3" in said


def diagnose_step_by_step(said, truth):
    hidden = json.loads((DATA / "hidden_truth.json").read_text())
    fit, power = numbers(said, "fit # %, but the residual has # times")
    assert fit > 98.0
    assert power > 10.0
    assert "ranked first: loop_delay" in said
    assert "explained loop_delay" in said
    for name in ("tau_e", "loop_delay.delay"):
        assert numbers(said, f"{name}: # s") == pytest.approx([hidden[name]], rel=0.01)
    assert numbers(said, "misfit of the other record: #") == pytest.approx([1.0], abs=0.1)


def dry_friction(said, truth):
    assert "none_of_the_candidates: what is missing acts most likely as a force" in said
    assert "sign ds/dt" in said
    left = numbers(said, "measured force over v: misfit #, of the other record #")
    assert max(left) < 1.3
    table = [float(force) for speed, force in re.findall(r"(\S+) mm/s +(\S+) N", said) if 1.0 < float(speed) < 20.0]
    assert np.mean(table) == pytest.approx(-3.0, abs=0.3)


def effect_of_your_own(said, truth):
    cubic, error, true = numbers(said, "hardening: cubic # +- # N/m^3; # was put in")
    assert abs(cubic - true) < 5.0 * error
    (before,) = numbers(said, "misfit #")
    assert before > 5.0
    assert numbers(said, "with it the misfit falls to #;") == pytest.approx([1.0], abs=0.1)
    assert re.search(r"^hardening .*\n.* would leave", said, re.MULTILINE), "it is ranked first"
    assert "loaded again with hardening" in said


def embedded_simulator(said, truth):
    size, microseconds = numbers(said, "largest y.A_zeta # um, # us a step from Python")
    assert microseconds < 1e3
    assert numbers(said, "differ by # m")[0] < 1e-9 * 1e-6 * size


def identify_a_rig(said, truth):
    for name, true in truth.items():
        value, error = numbers(said, f"{name} # # ")
        assert abs(value - true) < 4.0 * error
    assert "converged" in said
    assert numbers(said, "misfit #") == pytest.approx([1.0], abs=0.1)
    assert numbers(said, "tau_e of the model that was saved: # ms") == pytest.approx([1e3 * value], rel=0.01)


def monte_carlo(said, truth):
    share, spread = numbers(said, "tau_e: # % of the intervals held the truth, # % spread")
    assert share > 80.0
    assert 0.1 < spread < 0.5
    assert "40 runs: 40 converged" in said


def two_operating_points(said, truth):
    assert "at rest alone: adequate" in said
    assert numbers(said, "explained by gyroscopic_coupling, factor #") == pytest.approx([0.3], abs=0.02)
    for words in ("virtual experiment: misfit #", "virtual experiment (at 600 rad/s): misfit #"):
        assert numbers(said, words) == pytest.approx([1.0], abs=0.1)
    for name, true in (("K_i.A_zeta", 200.0), ("K_i.A_zeta@7.2A", 200.0), ("tau_e", 4e-4)):
        value, error = numbers(said, f"{name}: # +- #")
        assert abs(value - true) < 4.0 * error


def rotor_from_elsewhere(said, truth):
    fits = []
    for source in ("modal test", "dimensions"):
        fit, k_i = numbers(said, f"{source}: fit # %, K_i.A_zeta #")
        assert k_i == pytest.approx(truth["K_i.A_zeta"], rel=0.005)
        fits.append(fit)
    assert fits[0] == pytest.approx(fits[1], abs=0.1)


CLAIMS = [
    controller_from_control,
    diagnose_step_by_step,
    dry_friction,
    effect_of_your_own,
    embedded_simulator,
    identify_a_rig,
    monte_carlo,
    two_operating_points,
    rotor_from_elsewhere,
]


def test_all_are_known_here():
    assert {path.stem for path in FOLDER.glob("*.py")} == {claim.__name__ for claim in CLAIMS}


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_it_is_short(path):
    assert len(path.read_text().splitlines()) < 60


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.__name__)
def test_it_runs_and_what_it_says_is_true(claim, demo_truth, tmp_path):
    name = claim.__name__
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    ended = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", str(FOLDER / f"{name}.py")],
        cwd=tmp_path,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    claim(ended.stdout, demo_truth)
    assert not list(tmp_path.iterdir())
