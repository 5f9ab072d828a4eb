"""How `identify` and what comes back are called: files, prefixes, values, names."""

from functools import cache

import pytest

import ambid
from ambid.errors import ModelError, RecordError
from places import LEVITATOR


@cache
def record():
    i_e = ambid.prbs(8, amplitude=0.3, hold=2, axes=1, periods=4)
    return ambid.Model(ambid.Rig.load(LEVITATOR)).virtual_experiment(i_e, seed=1)


@pytest.fixture
def rig():
    return ambid.Rig.load(LEVITATOR)


def test_a_file_is_as_good_as_what_is_in_it(rig, tmp_path):
    record().save(tmp_path / "run.mat")
    path = tmp_path / "run.mat"
    loaded = ambid.Record.load(path, rig)
    assert ambid.identify(rig, str(path)).model.theta == pytest.approx(ambid.identify(rig, loaded).model.theta)
    assert len(ambid.compare(rig, [path, loaded]).records) == 2
    assert ambid.diagnose(rig, path, validate=str(path)).verdict == "adequate"
    assert len(ambid.check(rig, path).records) == 1
    with pytest.raises(RecordError, match="nothing\\.mat"):
        ambid.identify(rig, tmp_path / "nothing.mat")


def test_free_is_one_name_or_several(rig):
    found = ambid.identify(rig, record(), free="K_i")
    assert list(found.parameters) == ["K_i.A_zeta"]
    assert list(ambid.identify(rig, record(), free=["K_i", "tau_e"]).parameters) == ["K_i.A_zeta", "tau_e"]


def test_fixed_may_have_values(rig):
    found = ambid.identify(rig, record(), fixed={"tau_e": 2.5e-4})
    assert list(found.parameters) == ["K_i.A_zeta", "K_s.A_zeta"]
    assert found.model.theta[2] == 2.5e-4
    assert ambid.identify(rig, record(), fixed="tau_e").model.theta[2] == rig.actuator.time_constant


def test_a_parameter_is_found_by_its_name(rig, golden):
    found = ambid.identify(rig, record(), fixed="tau_e")
    assert found["K_i.A_zeta"] is found.parameters["K_i.A_zeta"]
    with golden.raises(ModelError):
        found["K_i.A_zetta"]
    with golden.raises(ModelError):
        found["tau_e"]


@pytest.mark.parametrize(
    "ask",
    [
        lambda model: model.with_values({"tau_f": 1.0}),
        lambda model: model.add("loop_dely"),
        lambda model: model.add("loop_delay", {"dela": 1e-5}),
        lambda model: ambid.identify(model, record(), free="K_s.A_zetta"),
    ],
    ids=["value", "effect", "parameter", "free"],
)
def test_a_wrong_name_is_refused_with_what_comes_nearest(rig, ask, golden):
    with golden.raises(ModelError):
        ask(ambid.Model(rig))


def test_a_rig_is_saved_as_the_file_that_loads_it(rig, tmp_path):
    rig.save(tmp_path / "rig.toml")
    assert ambid.Rig.load(tmp_path / "rig.toml") == rig
