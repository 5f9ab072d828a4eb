"""Every example runs by itself, says what it found, and leaves nothing behind."""

import os
import re
import subprocess
import sys

import pytest

from places import ROOT

FOLDER = ROOT / "python" / "examples"
SAID = {
    "controller_from_control": r"digital: stable.*zone [AB] of ISO 14839-3.*inputs i_e_A_zeta",
    "diagnose_step_by_step": r"fit 99\.\d %.*ranked first: loop_delay.*\.delay: 2\.\d*e-05 s.*explained loop_delay",
    "effect_of_your_own": r"hardening +would leave.*cubic (5|5\.\d+|4\.9\d*)e\+14.*falls to (0\.9|1\.0).*with harden",
    "embedded_simulator": r"us a step from Python.*differ by \d\.\de-\d\d m",
    "identify_a_rig": r"tau_e +0\.00024\d+.*converged.*misfit (0\.9|1\.0)\d",
    "monte_carlo": r"(8[5-9]|9\d|100) % of the intervals held the truth",
    "two_operating_points": r"rest alone: adequate.*speed: explained by gyroscopic_c.* factor 0\.(29|3\d)\n.*@7\.2A",
    "rotor_from_elsewhere": r"modal test: fit 95\.\d+ %, K_i\.A_zeta 217\.\d\ndimensions: fit 95\.\d+ %, .* 217\.\d",
}
NEEDS = {"controller_from_control": "control"}


def test_all_are_known_here():
    assert {path.stem for path in FOLDER.glob("*.py")} == set(SAID)


@pytest.mark.parametrize("name", SAID)
def test_it_is_short(name):
    assert len((FOLDER / f"{name}.py").read_text().splitlines()) < 60


@pytest.mark.parametrize("name", SAID)
def test_it_runs(name, tmp_path):
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
    assert re.search(SAID[name], ended.stdout, re.DOTALL), ended.stdout
    assert not list(tmp_path.iterdir())
