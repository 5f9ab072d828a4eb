"""The demo tells a true story, and its data are what they are said to be."""

import json
import subprocess
import sys

import numpy as np
import pytest

import ambid
from ambid.demo import DATA
from hidden.bench import simulate
from virtual import NAMES

RECORDS = {"hidden_train": (0.5, 3), "hidden_validate": (0.25, 7)}
"""Amplitude of the excitation [A], and seed."""


@pytest.fixture(scope="module")
def truth():
    return json.loads((DATA / "hidden_truth.json").read_text())


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What the command wrote and said, and the folder that it was given."""
    folder = tmp_path_factory.mktemp("demo")
    program = [sys.executable, "-c", "from ambid.cli import main; main()"]
    options = ["demo", "--out", folder / "story", "--json", folder / "demo.json"]
    ended = subprocess.run([*program, *options], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    return json.loads((folder / "demo.json").read_text()), ended.stdout, folder / "story"


@pytest.mark.parametrize("name", RECORDS)
def test_the_hidden_records_come_from_the_independent_machine(name, truth, demo_rig):
    amplitude, seed = RECORDS[name]
    i_e = ambid.prbs(8, amplitude=amplitude, hold=4, axes=4, periods=4, seed=seed)
    K_i, K_s = ([truth[f"{kind}.{axis}"] for axis in demo_rig.axes] for kind in ("K_i", "K_s"))
    delay = {"loop_delay": {"seconds": truth["loop_delay.delay"]}}
    made = simulate(demo_rig, i_e, delay, K_i=K_i, K_s=K_s, tau_e=truth["tau_e"], seed=seed)
    kept = ambid.Record.load(DATA / f"{name}.mat", demo_rig)
    assert (kept.period, kept.periods) == (1020, 4)
    for signal in ("i_e", "y", "i_c"):
        found, expected = getattr(kept, signal), getattr(made, signal)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_it_says_what_it_does(told):
    result, text, _ = told
    for words in ("Closed-loop identification", "static loading", "noise ceiling", "misfit"):
        assert words in text
    assert tuple(result["identify"]["parameters"]) == NAMES
    assert tuple(result["static_load"]["parameters"]) == NAMES[:4]


def test_the_fit_looks_well_and_is_wrong(told, truth):
    result = told[0]
    assert result["identify"]["fit_percent"]["average"] > 99.0
    assert result["compare"]["records"][0]["misfit"] > 10.0
    tau_e = result["identify"]["parameters"]["tau_e"]
    assert tau_e["ci95"][0] > truth["tau_e"]


def test_the_hidden_effect_is_found_and_the_parameters_come_right(told, truth):
    found = told[0]["diagnose"]
    assert (found["verdict"], found["effects"]) == ("explained", ["loop_delay"])
    last = found["history"][-1]
    assert last["misfit"] == pytest.approx(1.0, abs=0.1)
    assert last["validation_misfit"] == pytest.approx(1.0, abs=0.1)
    for name, p in found["parameters"].items():
        assert p["value"] == pytest.approx(truth[name], rel=0.01)


def test_it_names_the_folder_and_everything_in_it(told):
    result, text, folder = told
    assert f"Everything is in the folder {folder}; begin with {folder / 'report.html'}" in text
    assert sorted(result["files"]) == sorted(str(path) for path in folder.iterdir())
    for name in ("report.html", "ranking.png", "misfit_map.png", "measured_and_simulated.png", "model.json"):
        assert (folder / name).stat().st_size > 0
    assert all(text.index(f"{n}. ") < text.index(f"{n + 1}. ") for n in range(1, 5))


def test_the_model_that_it_leaves_can_be_loaded(told, truth):
    model = ambid.Model.load(told[2] / "model.json")
    assert [effect.name for effect in model.effects] == ["loop_delay"]


def test_the_demo_data_are_small():
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 1_500_000
