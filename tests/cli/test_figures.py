"""What the figures of commands take beside a record: a model before, a stretch, an effect to be predicted."""

import json
from pathlib import Path

import pytest

import ambid
from places import LEVITATOR


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A rig file of one axis, a record of it with a slow sensor, and the fit that does not know of that."""
    folder = tmp_path_factory.mktemp("figures")
    rig = ambid.Rig.load(LEVITATOR)
    (folder / "rig.toml").write_text(rig.to_toml())
    i_e = ambid.prbs(9, amplitude=0.3, hold=2, axes=1, periods=4)
    late = ambid.Model(rig).add("sensor_lag", {"time_constant": 1e-4})
    record = late.virtual_experiment(i_e, seed=4)
    record.save(folder / "run.csv")
    ambid.identify(rig, record).save(folder / "first.json")
    ambid.identify(ambid.Model(rig).add("sensor_lag"), record).save(folder / "last.json")
    return folder


@pytest.fixture
def here(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return {name: files / name for name in ("rig.toml", "run.csv", "first.json", "last.json")}


@pytest.mark.slow
def test_a_response_before_and_after_with_its_matrix(here, command):
    models = ["--model", here["last.json"], "--before", here["first.json"]]
    made = command(
        "frequency-response", here["rig.toml"], here["run.csv"], *models, "--json", "f.json", "--plot", "f.png"
    )
    assert (made.code, made.err) == (0, "")
    shown = json.loads(Path("f.json").read_text())
    (before,) = shown["responses"][0]["before"]
    assert before["name"] == "base model"
    assert before["model"] != shown["responses"][0]["model"]
    assert shown["matrix"][0]["inputs"] == ["i_e.A_zeta"]
    assert f"{shown['matrix'][0]['record']}, by excitation:" in made.out
    assert Path("f.png").stat().st_size > 10_000


def test_what_a_candidate_would_leave(here, command, refused):
    found = command(
        "rank", here["rig.toml"], here["run.csv"], "--predict", "sensor_lag", "--json", "r.json", "--plot", "r.png"
    )
    assert (found.code, found.err) == (0, "")
    (own,) = json.loads(Path("r.json").read_text())["prediction"]["records"]
    assert len(own["misfit"]) == len(own["misfit_then"])
    assert Path("r.png").stat().st_size > 10_000
    wrong = command("rank", here["rig.toml"], here["run.csv"], "--predict", "sensor_lug")
    refused(wrong, "sensor_lug")


def test_a_stretch_of_choice_and_the_model_before(here, command):
    before = ["--model", here["last.json"], "--before", here["first.json"]]
    found = command("compare", here["rig.toml"], here["run.csv"], *before, "--stretch", "0.1:0.15", "--plot", "c.png")
    assert (found.code, found.err) == (0, "")
    assert Path("c.png").stat().st_size > 10_000
    assert "matrix" in json.loads(command("compare", here["rig.toml"], here["run.csv"], "--json", "-", "-q").out)


@pytest.mark.parametrize("stretch", ["0.1", "a:1", "1:0.5"])
def test_a_stretch_that_is_none_is_refused(here, command, stretch, refused):
    refused(
        command("compare", here["rig.toml"], here["run.csv"], "--stretch", stretch, "--plot", "c.png"),
        prints=stretch == "1:0.5",
    )
