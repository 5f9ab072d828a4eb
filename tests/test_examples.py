"""Every example runs by itself, finds what is true, and leaves nothing behind."""

import ast
import json
import os
import runpy
import subprocess
import sys

import numpy as np
import pytest

import ambid
from ambid.demo import DATA
from places import ROOT

FOLDER = ROOT / "python" / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
NEEDS = {"controller_from_control": "control"}


def controller_from_control(names, truth):
    assert names["model"].is_stable
    assert names["model"].rig.controller.delay_samples == 0.5
    assert names["closed"].input_labels[0] == "i_e_A_zeta"
    assert ambid.check(names["model"].rig).loop.peak_sensitivity < 4.0


def diagnose_step_by_step(names, truth):
    hidden = json.loads((DATA / "hidden_truth.json").read_text())
    assert names["fit"] > 98.0
    assert names["misfit"] > 10.0
    assert names["best"].effect.name == "loop_delay"
    assert (names["found"].verdict, [*names["found"].effects]) == ("explained", ["loop_delay"])
    for name in ("tau_e", "loop_delay.delay"):
        assert names["better"].parameters[name].value == pytest.approx(hidden[name], rel=0.01)
    assert ambid.compare(names["better"].model, names["validate"]).misfit == pytest.approx(1.0, abs=0.1)


def dry_friction(names, truth):
    assert names["found"].verdict == "none_of_the_candidates"
    assert max(names["misfits"]) < 1.3
    assert names["force"].name == "force"
    at, force = np.array(names["shape"].at), np.array(names["shape"].values)
    assert np.mean(force[(at > 1e-3) & (at < 20e-3)]) == pytest.approx(-3.0, abs=0.3)


def effect_of_your_own(names, truth):
    assert abs(names["cubic"].value - 5e14) < 5.0 * names["cubic"].std_error
    assert names["ranking"].misfit > 5.0
    assert names["left"] == pytest.approx(1.0, abs=0.1)
    assert names["best"].effect.name == names["again"].effects[0].name == "hardening"


def embedded_simulator(names, truth):
    assert np.abs(names["stepped"][:, :4] - names["whole"].y).max() < 1e-9 * np.abs(names["outputs"]).max()
    assert np.array_equal(names["outputs"], names["stepped"])


def identify_a_rig(names, truth):
    estimate = names["estimate"]
    assert estimate.status == "converged"
    for name, true in truth.items():
        assert abs(estimate.parameters[name].value - true) < 4.0 * estimate.parameters[name].std_error
    assert names["comparison"].misfit == pytest.approx(1.0, abs=0.1)
    assert names["again"].parameters[-1].value == pytest.approx(estimate.parameters["tau_e"].value)


def monte_carlo(names, truth):
    assert names["inside"] > 80.0
    assert 0.1 < names["spread"] < 0.5
    assert names["found"].status == {"converged": 24}


def two_operating_points(names, truth):
    both = names["both"]
    assert names["alone"].verdict == "adequate"
    assert (both.verdict, [*both.effects]) == ("explained", ["gyroscopic_coupling"])
    assert names["factor"] == pytest.approx(0.3, abs=0.02)
    assert len(both.model.names) == 10  # no gains of its own for another speed
    for own in ambid.compare(both.model, [names["at_rest"], names["at_speed"]]).records:
        assert own.misfit == pytest.approx(1.0, abs=0.1)
    for name, true in (("K_i.A_zeta", 200.0), ("K_i.A_zeta@7.2A", 200.0), ("tau_e", 4e-4)):
        found = names["joint"].parameters[name]
        assert abs(found.value - true) < 4.0 * found.std_error


def rotor_from_elsewhere(names, truth):
    tested, drawn = names["estimates"].values()
    for own in (tested, drawn):
        assert own.parameters["K_i.A_zeta"].value == pytest.approx(truth["K_i.A_zeta"], rel=0.005)
    assert tested.fit_percent["average"] == pytest.approx(drawn.fit_percent["average"], abs=0.1)


FAST = [controller_from_control, embedded_simulator, identify_a_rig, rotor_from_elsewhere]
SLOW = [diagnose_step_by_step, dry_friction, effect_of_your_own, monte_carlo, two_operating_points]


def test_all_are_known_here():
    assert {path.stem for path in SCRIPTS} == {claim.__name__ for claim in FAST + SLOW}


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_it_is_short(path):
    assert len(path.read_text().splitlines()) < 60


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_every_name_of_the_package_exists(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "ambid":
            assert hasattr(ambid, node.attr), node.attr


@pytest.mark.parametrize(
    "claim", [*FAST, *(pytest.param(claim, marks=pytest.mark.slow) for claim in SLOW)], ids=lambda claim: claim.__name__
)
def test_what_it_finds_is_true(claim, demo_truth, tmp_path, monkeypatch, capsys):
    name = claim.__name__
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    monkeypatch.chdir(tmp_path)
    found = runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    assert capsys.readouterr().out
    claim(found, demo_truth)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_one_runs_in_a_process_of_its_own(tmp_path):
    ended = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", str(FOLDER / "embedded_simulator.py")],
        cwd=tmp_path,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout
    assert not list(tmp_path.iterdir())
