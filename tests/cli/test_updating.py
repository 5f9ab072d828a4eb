"""``--save-rig``: what records say of the rig file, as a rig file."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.results import readable
from places import LEVITATOR

SLOWER = 0.04
"""Relative error of the amplifier in the rig file: within its tolerance."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A rig file with a tolerance, and a record of the machine, whose amplifier is slower than it says."""
    folder = tmp_path_factory.mktemp("slower")
    rig = ambid.Rig.load(LEVITATOR)
    rig.replace(tolerance={}).save(folder / "rig.toml")
    rig.exact().save(folder / "exact.toml")
    lag = (1.0 + SLOWER) * rig.amplifier.time_constant
    true = rig.replace(amplifier=rig.amplifier.model_copy(update={"time_constant": lag}))
    i_e = ambid.prbs(8, amplitude=0.1, hold=2, axes=1, periods=6)
    ambid.Model(true).virtual_experiment(i_e, seed=1).save(folder / "run.csv")
    return folder


@pytest.fixture
def here(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("rig.toml", "exact.toml", "run.csv"):
        Path(name).symlink_to(files / name)
    return tmp_path


@pytest.mark.parametrize("name", ["identify", "diagnose"])
def test_the_rig_file_has_what_the_records_say(here, command, name):
    made = command(name, "rig.toml", "run.csv", "--save-rig", "new.toml", "--save", "m.json", "--json", "found.json")
    assert (made.code, made.err) == (0, "")
    old, new = ambid.Rig.load("rig.toml"), ambid.Rig.load("new.toml")
    found = json.loads(Path("found.json").read_text())
    known = found["tolerances"]["amplifier_time_constant.A_zeta"]
    assert known["posterior_value"] == pytest.approx(SLOWER, abs=4.0 * known["posterior_std"])
    ratio = new.amplifier.time_constant / old.amplifier.time_constant
    assert ratio == pytest.approx(1.0 + known["posterior_value"], rel=1e-12)
    update = found["rig_update"]
    assert update.keys() == found["tolerances"].keys()
    left = {own for own in update if update[own]["not_in_rig"]}
    assert left == {"sensor_gain.A_zeta", "current_gain.A_zeta", "excitation_gain", "instant"}
    assert all(
        update[own]["not_in_rig"] == update[own]["error"] == found["tolerances"][own]["posterior_value"] for own in left
    )
    codes = [own["code"] for own in found["findings"]]
    assert codes.count("rig_key_missing") == len(left)
    text = Path("new.toml").read_text()
    assert all(own in text.partition("\nname")[0] and own in made.out for own in update)
    assert "new.toml" in made.out
    # the saved model on the old rig, without what no key holds, is that of the new rig
    model = ambid.Model.load("m.json")
    values = dict(zip(model.names, model.theta, strict=True))
    i_e = ambid.prbs(7, amplitude=0.1, hold=2, axes=1, periods=2)
    own = ambid.Model(new.exact()).with_values({n: v for n, v in values.items() if n not in update}).simulate(i_e)
    with_errors = model.with_values(dict.fromkeys(left, 0.0)).simulate(i_e)
    np.testing.assert_allclose(own.outputs, with_errors.outputs, rtol=0.0, atol=1e-6 * np.abs(own.outputs).max())


def test_how_well_and_by_what_is_in_json_and_beside(here, command):
    made = command("identify", "rig.toml", "run.csv", "--json", "i.json")
    assert command("diagnose", "rig.toml", "run.csv", "--json", "d.json").code == 0
    identified, diagnosed = (json.loads(Path(name).read_text()) for name in ("i.json", "d.json"))
    assert made.code == 0
    for found in (identified, diagnosed):
        for name, p in found["parameters"].items():
            parts = found["budget"][name]
            assert parts["noise"] ** 0.5 == pytest.approx(p["std_error_statistical"])
            assert sum(parts.values()) == pytest.approx(p["std_error"] ** 2, rel=1e-6)
            assert parts.keys() == {"noise", *found["tolerances"]}
        assert {"typical_tolerances"} <= {own["code"] for own in found["findings"]}
        for own in found["tolerances"].values():
            assert own["value"] == 0.0
            assert own["posterior_std"] < own["std"] * (1.0 + 1e-9)
    assert identified["parameters"]["K_i.A_zeta"]["std_error"] == pytest.approx(
        diagnosed["parameters"]["K_i.A_zeta"]["std_error"], rel=0.02
    )
    assert all(name in made.out for name in identified["tolerances"])


def test_what_is_exact_has_none_of_that(here, command):
    made = command("identify", "exact.toml", "run.csv", "--json", "i.json")
    found = json.loads(Path("i.json").read_text())
    assert (found["tolerances"], found["budget"]) == ({}, {})
    assert all(p["std_error"] == p["std_error_statistical"] for p in found["parameters"].values())
    assert "amplifier_time_constant" not in made.out


def test_eq_9_updates_nothing(here, command, refused):
    refused(command("identify", "rig.toml", "run.csv", "--weight", "eq9", "--save-rig", "new.toml"), "new.toml")


def test_a_diagnosis_that_cannot_begin_updates_nothing(here, command):
    record = ambid.Record.load("run.csv", ambid.Rig.load("rig.toml"))
    other = np.random.default_rng(0).choice([-0.1, 0.1], (record.period, 1))
    dataclasses.replace(record, i_e=np.tile(other, (record.periods, 1))).save("foreign.csv")
    made = command("diagnose", "rig.toml", "foreign.csv", "--save-rig", "new.toml", "--json", "d.json")
    found = json.loads(Path("d.json").read_text())
    assert found["verdict"] == "not_informative"
    assert found["rig_update"] == {}
    assert "rig_not_updated" in [own["code"] for own in found["findings"]]
    assert "new.toml" in made.out
    assert not Path("new.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["exact.toml", "run.csv", "--save-rig", "new.toml"], "new.toml"),
        (["rig.toml", "run.csv", "--exact", "--save-rig", "new.toml"], "new.toml"),
        (["rig.toml", "run.csv", "--save-rig", "new.json"], "new.json"),
        (["rig.toml", "run.csv", "--save-rig", "rig.toml"], "rig.toml"),
        (["rig.toml", "run.csv", "--save-rig", "exact.toml"], "exact.toml"),
    ],
    ids=["exact by its file", "exact", "no rig file", "its own input", "there already"],
)
@pytest.mark.parametrize("name", ["identify", "diagnose"])
def test_what_would_be_no_update_is_refused_before_any_work(here, command, name, arguments, named, refused):
    refused(command(name, *arguments), named)
    assert not Path("new.toml").exists()


def test_a_value_that_is_moved_far_is_told_with_how_to_take_it(here, command):
    rig = ambid.Rig.load("rig.toml")
    rig.replace(tolerance={"amplifier_time_constant": 0.02}).save("tight.toml")
    made = command("identify", "tight.toml", "run.csv", "--json", "i.json")
    found = json.loads(Path("i.json").read_text())["findings"]
    (moved,) = (own for own in found if own["code"] == "rig_value_moved" and "amplifier" in own["where"]["key"])
    assert readable(moved["values"]["error"], "1") in moved["message"]
    assert "--save-rig" in made.out


def test_where_physics_is_missing_the_update_is_in_doubt(here, command):
    rig = ambid.Rig.load("rig.toml")
    late = ambid.Model(rig).add("loop_delay", {"delay": 1e-4})
    late.virtual_experiment(ambid.prbs(8, amplitude=0.1, hold=2, axes=1, periods=4), seed=1).save("late.csv")
    assert command("identify", "rig.toml", "late.csv", "--save-rig", "new.toml", "--json", "i.json").code == 0
    found = json.loads(Path("i.json").read_text())
    (doubt,) = (own for own in found["findings"] if own["code"] == "rig_update_doubtful")
    assert not found["adequate"]
    assert f"# {doubt['message']}" in Path("new.toml").read_text()
    assert ambid.Rig.load("new.toml") != rig
