"""``--mend`` and ``--save-rig``: what a diagnosis names as wrong in record or rig is corrected."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import ambid
from places import LEVITATOR


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A levitator's rig file, one with another gain, and records of it, two of which are wrong."""
    monkeypatch.chdir(tmp_path)
    rig = ambid.Rig.load(LEVITATOR).replace(tolerance={})
    rig.save("rig.toml")
    pid = rig.controller
    rig.replace(controller=pid.model_copy(update={"proportional": 1.3 * pid.proportional})).save("wrong.toml")
    record = ambid.Model(rig).virtual_experiment(ambid.prbs(8, amplitude=0.1, hold=2, axes=1, periods=6), seed=1)
    record.save("run.csv")
    replace(record, y=-record.y).save("turned.csv")
    return tmp_path


def diagnosed(command, *words):
    made = command("diagnose", *words, "--json", "found.json")
    return made, json.loads(Path("found.json").read_text())


@pytest.mark.slow
def test_a_mended_record_is_right_and_says_what_was_corrected(here, command):
    made, found = diagnosed(command, "rig.toml", "turned.csv", "--mend", "mended.csv")
    assert (made.code, found["effects"]) == (0, ["channel_sign"])
    (line,) = found["mended"]["mended.csv"]
    assert line in made.out
    rig = ambid.Rig.load("rig.toml")
    right, mended = (ambid.Record.load(path, rig) for path in ("run.csv", "mended.csv"))
    for signal in ("y", "i_c", "i_e"):
        assert getattr(mended, signal) == pytest.approx(getattr(right, signal), rel=1e-12)
    assert diagnosed(command, "rig.toml", "mended.csv")[1]["verdict"] == "adequate"


def test_a_corrected_rig_is_right(here, command):
    _, found = diagnosed(command, "wrong.toml", "run.csv", "--save-rig", "new.toml")
    assert found["effects"] == ["controller_gain_error"]
    update = found["rig_update"]["controller_gain_error.proportional"]
    assert update["tolerance"] is None
    old, new = (ambid.Rig.load(path).controller.proportional for path in ("wrong.toml", "new.toml"))
    own_tolerance = 1.0 + found["rig_update"]["controller_gain.proportional"]["error"]
    assert new == pytest.approx((1.0 + update["error"]) * own_tolerance * old, rel=1e-12)
    assert new == pytest.approx(ambid.Rig.load("rig.toml").controller.proportional, rel=0.03)
    assert diagnosed(command, "new.toml", "run.csv")[1]["verdict"] == "adequate"


def test_where_nothing_is_wrong_nothing_is_written(here, command):
    _, found = diagnosed(command, "rig.toml", "run.csv", "--mend", "mended.csv")
    assert found["mended"] == {}
    assert "record_not_mended" in [own["code"] for own in found["findings"]]
    assert not Path("mended.csv").exists()


@pytest.mark.parametrize("path", ["mended.xyz", "run.csv"], ids=["no format", "its own input"])
def test_what_cannot_be_written_is_refused_before_any_work(here, command, path, refused):
    refused(command("diagnose", "rig.toml", "run.csv", "--mend", path), path)
