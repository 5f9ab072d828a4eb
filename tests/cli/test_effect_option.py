"""Effects as options of the command: what they make of a model, and what is refused."""

import pytest

from ambid.cli.effect_option import with_effects
from ambid.effects import CATALOGUE
from ambid.errors import ModelError
from ambid.model import Model


@pytest.fixture(scope="module")
def model(demo_rig):
    return Model(demo_rig)


def values(model, effect):
    return {p.name.removeprefix(f"{effect}."): p.value for p in model.parameters if p.name.startswith(f"{effect}.")}


def test_effects_with_values(model):
    found = with_effects(model, ["sensor_gain_error:zeta=-0.05, eta=0.02", "sensor_lag:time_constant=2e-5"])
    assert [effect.name for effect in found.effects] == ["sensor_gain_error", "sensor_lag"]
    gains = values(found, "sensor_gain_error")
    assert gains == {"zeta": -0.05, "eta": 0.02}
    assert values(found, "sensor_lag") == {"time_constant": 2e-5}
    assert with_effects(model, []) is model


def test_what_is_left_out_is_typical(model):
    assert values(with_effects(model, ["loop_delay"]), "loop_delay") == values(model.add("loop_delay"), "loop_delay")


def test_settings_of_an_effect(model):
    found = with_effects(model, ["seal_forces:z=0.43,cross_stiffness=2e5,direct_stiffness=-1e4"])
    assert found.effects[0].settings() == {"z": 0.43}
    assert values(found, "seal_forces")["cross_stiffness"] == 2e5
    assert with_effects(model, ["coupling_stiffness:end=1"]).effects[0].settings() == {"end": 1}


def test_a_name_that_is_both_sets_the_value(model):
    found = with_effects(model, ["foundation_resonance:frequency_hz=70"])
    assert values(found, "foundation_resonance")["frequency_hz"] == 70.0


def test_an_axis_by_its_name(model):
    found = with_effects(model, ["periodic_disturbance:frequency_hz=50,axis=B_zeta,cosine=0.01"])
    assert found.effects[0].settings()["axis"] == model.rig.axes.index("B_zeta")
    each = with_effects(model, ["periodic_disturbance:frequency_hz=50,port=force,axis=each,sine_A_eta=2"])
    assert values(each, "periodic_disturbance")["sine_A_eta"] == 2.0
    assert each.effects[0].settings()["port"] == "force"


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("loop_delya", "loop_delya: no such effect; did you mean loop_delay? the catalogue has rotor_bending_mode"),
        ("", "no such effect"),
        ("loop_delay:lag=1e-5", "no parameter lag; loop_delay has delay"),
        ("seal_forces:x=1", "no parameter x; seal_forces has direct_stiffness, cross_stiffness, damping, and the sett"),
        ("loop_delay:", "expected NAME or NAME:param=value,..., such as loop_delay:delay=5e-5"),
        ("loop_delay:delay", "'delay': expected NAME or NAME:param=value"),
        ("loop_delay:delay=", "expected NAME or NAME:param=value"),
        ("loop_delay:delay=50us", "delay = '50us' is no number; give one in SI units"),
        ("loop_delay:delay=nan", "loop_delay.delay = nan: expected"),
        ("loop_delay:delay=-1e-5", "loop_delay.delay = -1e-05: expected 5e-09 to 0.002 in s"),
        ("loop_delay:delay=1e-5,delay=2e-5", "a parameter is named twice"),
        ("seal_forces:z=front", "z = 'front' is no number"),
        ("seal_forces:z=4.3", "position"),
        ("coupling_stiffness:end=7", "end = 7: the rig has no such place or axis"),
        ("coupling_stiffness:end=1.5", "end = '1.5' is no whole number"),
        ("force_nonlinearity:held=0.1", "held = '0.1': it holds a number of each axis"),
        ("unbalance:z=0.4,in_phase=1e-6", "unbalance makes no sense on this rig"),
    ],
)
def test_options_that_are_refused(model, option, words):
    with pytest.raises(ModelError) as caught:
        with_effects(model, [option])
    assert str(caught.value).startswith(f"--effect {option}: ")
    assert words in str(caught.value)


def test_the_same_effect_twice(model, golden):
    with golden.raises(ModelError):
        with_effects(model, ["loop_delay", "loop_delay:delay=1e-5"])


def test_every_effect_of_the_catalogue_can_be_asked_for(model):
    for effect in CATALOGUE:
        if effect.parameters(model.rig):
            assert with_effects(model, [effect.name]).effects[0].name == effect.name
