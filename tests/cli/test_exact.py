"""``--exact``: every command that takes a rig file takes its values for exact, whatever its table says."""

import inspect
import json
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.cli.app import app
from places import LEVITATOR

WITHOUT = {"init", "export", "effects", "demo"}
"""Commands that use no rig file, or none of its values."""


@pytest.fixture(scope="module")
def files(tmp_path_factory, command_in):
    """A machine of one axis that is exact by its file, the same with tolerances, and a record."""
    folder = tmp_path_factory.mktemp("files")
    rig = ambid.Rig.load(LEVITATOR)
    rig.save(folder / "plain.toml")
    rig.exact().save(folder / "exact.toml")
    rig.replace(tolerance={"sensor_gain": 0.02}).save(folder / "known.toml")
    i_e = ambid.prbs(8, amplitude=0.1, hold=2, axes=1, periods=4)
    ambid.Model(rig).virtual_experiment(i_e, seed=1).save(folder / "run.csv")
    done = command_in(folder, "identify", "known.toml", "run.csv", "--save", "known.json", "-q")
    assert done.code == 0
    return folder


@pytest.fixture
def here(files, monkeypatch):
    monkeypatch.chdir(files)


def of(file):
    return json.loads(Path(file).read_text())


@pytest.mark.parametrize("command", app.registered_commands, ids=lambda command: command.name)
def test_every_command_that_uses_values_of_a_rig_file_has_it(command):
    assert ("exact" in inspect.signature(command.callback).parameters) == (command.name not in WITHOUT)


def test_a_rig_with_tolerances_is_that_without(here, command):
    assert command("identify", "known.toml", "run.csv", "--json", "total.json").code == 0
    assert command("identify", "known.toml", "run.csv", "--exact", "--json", "exact.json").code == 0
    assert command("identify", "exact.toml", "run.csv", "--json", "file.json").code == 0
    total, exact, by_file = map(of, ("total.json", "exact.json", "file.json"))
    assert exact["parameters"] == by_file["parameters"]
    assert (total["tolerances"].keys() >= {"mass", "sensor_gain.A_zeta"}, exact["tolerances"]) == (True, {})
    k_i = "K_i.A_zeta"
    assert total["parameters"][k_i]["std_error"] > 3.0 * exact["parameters"][k_i]["std_error"]


def test_diagnosis_and_comparison_take_it(here, command):
    for name in ("diagnose", "compare"):
        assert command(name, "known.toml", "run.csv", "--exact", "--json", "d.json").code == 0
        assert command(name, "exact.toml", "run.csv", "--json", "e.json").code == 0
        own, other = of("d.json"), of("e.json")
        assert {**own, "seconds": 0} == {**other, "seconds": 0}


def test_other_operating_points_are_exact_too(here, command):
    rig = ambid.Rig.load("known.toml")
    rig.replace(controller=rig.controller.model_copy(update={"proportional": 1.01 * rig.controller.proportional})).save(
        "point.toml"
    )
    made = command("compare", "known.toml", "run.csv", "point.toml", "run.csv", "--exact", "--json", "two.json")
    assert made.code == 0
    assert len(of("two.json")["records"]) == 2


def test_a_model_with_errors_of_the_rig_file_loses_them_and_says_so(here, command):
    saved = of("known.json")
    assert "sensor_gain.A_zeta" in saved["parameters"]
    made = command("margins", "known.toml", "--model", "known.json", "--draws", 50, "--exact", "--json", "m.json")
    assert made.code == 0
    (found,) = of("m.json")["findings"]
    assert found["code"] == "model_errors_not_taken"
    assert any(text.startswith("sensor_gain.A_zeta") for text in found["values"]["errors"])
    made = command("margins", "known.toml", "--model", "known.json", "--draws", 50, "--json", "m.json")
    assert (made.code, made.err) == (0, "")


def test_a_saved_model_fits_any_table(here):
    rig = ambid.Rig.load("known.toml")
    saved = ambid.Model.load("known.json")
    assert ambid.Model.load("known.json", rig.exact()).covariance.shape == (3, 3)
    more = ambid.Model.load("known.json", rig.replace(tolerance={"sensor_gain": 0.02, "excitation_gain": 0.0}))
    assert "excitation_gain" not in more.names
    again = ambid.Model.load("known.json", rig)
    assert again.names == saved.names
    np.testing.assert_array_equal(again.covariance, saved.covariance)


def test_a_value_that_only_the_rig_knows_to_a_tolerance_is_as_well_known_as_it_says(tmp_path):
    rig = ambid.Rig.load(LEVITATOR).replace(tolerance={"excitation_gain": 0.0})
    model = ambid.Model(rig).with_tolerances()
    model.save(tmp_path / "m.json", np.diag((0.01 * np.maximum(model.theta, 1e-6)) ** 2))
    more = ambid.Model.load(tmp_path / "m.json", rig.replace(tolerance={"excitation_gain": 0.003}))
    i = more.names.index("excitation_gain")
    assert more.theta[i] == 0.0
    assert more.covariance[i, i] == pytest.approx(0.003**2)
    assert np.count_nonzero(more.covariance[i]) == 1


def test_a_campaign_takes_it(tmp_path, files, command, monkeypatch):
    own = tmp_path / "campaign" / "4A"
    own.mkdir(parents=True)
    (own / "rig.toml").write_text((files / "known.toml").read_text())
    for k in (1, 2):
        (own / f"prbs_{k}.csv").write_text((files / "run.csv").read_text())
    monkeypatch.chdir(tmp_path)
    for name, more in (("total.json", ()), ("exact.json", ("--exact",))):
        assert command("campaign", "campaign", *more, "--json", name).code == 0
    points = [of(name)["points"][0]["closed_loop"]["prbs"]["joint"] for name in ("total.json", "exact.json")]
    total, exact = (own["parameters"]["K_i.A_zeta"]["std_error"] for own in points)
    assert total > 3.0 * exact
