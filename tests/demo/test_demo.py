"""What the demo shows is true, and its data are what they are said to be."""

import json
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.demo import DATA, story
from demo.one_axis import one_axis
from hidden.bench import simulate

RECORDS = {"hidden_train": (0.5, 3), "hidden_validate": (0.25, 7)}
"""Amplitude of the excitation [A], and seed."""


@pytest.fixture(scope="module")
def truth():
    return json.loads((DATA / "hidden_truth.json").read_text())


@pytest.fixture(scope="module", params=["one axis", pytest.param("the bench", marks=pytest.mark.slow)])
def shown(request, tmp_path_factory, command_in):
    """The data of the story, what the command wrote and said, and the folder that it was given.

    The report, whose pictures take longest, is its text alone.
    """
    folder, data = tmp_path_factory.mktemp("demo"), DATA
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "one axis":
            data = one_axis(tmp_path_factory.mktemp("data"))
            patch.setattr(story, "DATA", data)
        patch.setattr(story, "write_report", lambda found, path: path.write_text(str(found)))
        ended = command_in(folder, "demo", "--out", folder / "story", "--json", folder / "demo.json")
    assert (ended.code, ended.err) == (0, "")
    return data, json.loads((folder / "demo.json").read_text()), ended.out, folder / "story"


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


def test_it_shows_what_it_found(shown):
    data, result, text, _ = shown
    names = ambid.Model(ambid.Rig.load(data / "rig.toml")).names
    assert tuple(result["identify"]["parameters"]) == names
    assert tuple(result["static_load"]["parameters"]) == tuple(name for name in names if name.startswith("K_i"))
    assert all(name in text for name in (*names, *result["diagnose"]["effects"]))
    assert all(text.index(f"{n}. ") < text.index(f"{n + 1}. ") for n in range(1, 6))


def test_the_fit_looks_well_and_is_wrong(shown):
    data, result, *_ = shown
    truth = json.loads((data / "hidden_truth.json").read_text())
    assert result["identify"]["fit_percent"]["average"] > 98.0
    assert result["compare"]["records"][0]["misfit"] > 10.0
    tau_e = result["identify"]["parameters"]["tau_e"]
    assert tau_e["ci95"][0] > truth["tau_e"]


def test_the_hidden_effect_is_found_and_the_parameters_come_right(shown):
    data, result, *_ = shown
    truth, found = json.loads((data / "hidden_truth.json").read_text()), result["diagnose"]
    assert (found["verdict"], found["effects"]) == ("explained", ["loop_delay"])
    last = found["history"][-1]
    assert last["misfit"] == pytest.approx(1.0, abs=0.1)
    assert last["validation_misfit"] == pytest.approx(1.0, abs=0.1)
    for name, p in found["parameters"].items():
        assert p["value"] == pytest.approx(truth[name], rel=0.01)


def test_tolerances_make_more_of_the_interval_than_noise(shown):
    _, result, text, _ = shown
    exact, known = result["closed_loop"], result["with_tolerances"]
    name = next(iter(known["parameters"]))
    assert (exact["tolerances"], "mass" in known["tolerances"]) == ({}, True)
    assert known["parameters"][name]["std_error"] > 3.0 * exact["parameters"][name]["std_error"]
    parts = known["budget"][name]
    assert max(parts, key=parts.get) in text


def test_it_names_the_folder_and_everything_in_it(shown):
    _, result, text, folder = shown
    assert all(str(path) in text for path in (folder, *map(Path, result["files"])))
    assert sorted(result["files"]) == sorted(str(path) for path in folder.iterdir())
    for name in ("report.html", "ranking.png", "misfit_map.png", "measured_and_simulated.png", "model.json"):
        assert (folder / name).stat().st_size > 0


def test_the_model_that_it_leaves_can_be_loaded(shown):
    model = ambid.Model.load(shown[-1] / "model.json")
    assert [effect.name for effect in model.effects] == ["loop_delay"]


def test_the_demo_data_are_small():
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 1_500_000
