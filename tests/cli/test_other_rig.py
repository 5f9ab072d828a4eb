"""A model that was saved of another rig is noted, with the keys that differ; nothing is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.rig.notes import differences
from places import BENCH, LEVITATOR


def of_another(file):
    """The findings of this kind in JSON."""
    return [own for own in json.loads(Path(file).read_text())["findings"] if own["code"] == "model_of_another_rig"]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A rig file, a model of it, and the rig file at another bias current and with other gains."""
    monkeypatch.chdir(tmp_path)
    text = LEVITATOR.read_text()
    Path("rig.toml").write_text(text)
    rig = ambid.Rig.load("rig.toml")
    model = ambid.Model(rig)
    model.save("model.json", np.diag((0.01 * model.theta) ** 2))
    (bearing,) = rig.bearings
    other = bearing.model_copy(update={"bias_current": 1.1 * bearing.bias_current})
    gains = rig.controller.model_copy(update={"proportional": 1.05 * rig.controller.proportional})
    rig.replace(bearings=(other,), controller=gains).save("other.toml")
    rig.replace(name="the same by another name").save("named.toml")
    return rig


def test_it_is_noted_on_stderr_and_in_json_with_both_values(here, command):
    found = command("margins", "other.toml", "--model", "model.json", "--draws", 50, "--json", "m.json")
    assert found.code == 0
    bias, gain = here.bearings[0].bias_current, here.controller.proportional
    (shown,) = of_another("m.json")
    assert shown["where"]["file"] == "model.json"
    assert shown["values"]["differences"] == {
        "bearing[0] (A).bias_current": {"saved": f"{bias:g}", "given": f"{1.1 * bias:g}"},
        "controller.proportional": {"saved": f"{gain:g}", "given": f"{1.05 * gain:g}"},
    }
    assert found.err == f"warning: model.json: {shown['message']}; {shown['remedy']}\n"
    assert f"model.json: {shown['message']}; {shown['remedy']}" in json.loads(Path("m.json").read_text())["notes"]


@pytest.mark.parametrize("rig", ["rig.toml", "named.toml"])
def test_the_same_rig_is_not_noted(here, command, rig):
    found = command("margins", rig, "--model", "model.json", "--draws", 50, "--json", "m.json")
    assert (found.code, found.err) == (0, "")
    assert of_another("m.json") == []


def test_a_note_is_of_its_own_command_alone(here, command):
    assert command("poles", "other.toml", "--model", "model.json", "--json", "other.json").err
    assert command("poles", "rig.toml", "--model", "model.json", "--json", "own.json").err == ""
    assert (len(of_another("other.json")), len(of_another("own.json"))) == (1, 0)


def test_a_point_that_the_model_was_fitted_at_is_its_own(here, command):
    other = ambid.Rig.load("other.toml")
    record = ambid.Model(other).virtual_experiment(ambid.prbs(7, amplitude=0.1, hold=4, axes=1, periods=4), seed=0)
    ambid.Model(here).covering([record.at(other)]).save("two.json")
    assert command("poles", "rig.toml", "--model", "two.json", "--json", "p.json").code == 0
    assert of_another("p.json") == []


def test_at_most_five_keys_are_told_and_nominal_values_last(here, command):
    rig = ambid.Rig.load(BENCH)
    ambid.Model(rig).save("bench.json")
    bearings = [
        b.model_copy(
            update={"bias_current": b.bias_current * 1.01, "force_current": tuple(k * 1.01 for k in b.force_current)}
        )
        for b in rig.bearings
    ]
    changes = {key: 1.01 * getattr(rig.controller, key) for key in ("proportional", "integral", "derivative")}
    rig.replace(bearings=bearings, controller=rig.controller.model_copy(update=changes)).save("changed.toml")
    command("poles", "changed.toml", "--model", "bench.json", "--json", "p.json")
    (shown,) = of_another("p.json")
    assert len(shown["values"]["differences"]) == 5
    assert shown["values"]["further"] == 2
    assert "force_current" not in shown["message"]


def test_other_kinds_and_counts_are_told_in_short(here):
    bench = ambid.Rig.load(BENCH)
    found = {key: (one, other) for key, one, other in differences(bench, here)}
    assert found["rotor.kind"] == ("'finite_elements'", "'mass'")
    assert found["[[bearing]]"] == ("2 tables", "1 tables")
    assert not any(key.startswith("rotor.section") for key in found)
    assert differences(bench, bench) == []
