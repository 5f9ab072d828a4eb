"""Effects as options of the command: what they make of a model, and what is refused."""

import pytest

from ambid.cli.options import with_effects
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
    "option",
    [
        "loop_delya",
        "",
        "loop_delay:lag=1e-5",
        "seal_forces:x=1",
        "loop_delay:",
        "loop_delay:delay",
        "loop_delay:delay=",
        "loop_delay:delay=50us",
        "loop_delay:delay=nan",
        "loop_delay:delay=-1e-5",
        "loop_delay:delay=1e-5,delay=2e-5",
        "seal_forces:z=front",
        "seal_forces:z=4.3",
        "coupling_stiffness:end=7",
        "coupling_stiffness:end=1.5",
        "force_nonlinearity:held=0.1",
        "unbalance:z=0.4,in_phase=1e-6",
    ],
)
def test_options_that_are_refused(model, option, golden):
    with pytest.raises(ModelError) as caught:
        with_effects(model, [option])
    text = str(caught.value)
    assert text.startswith(f"--effect {option}: ")
    golden.holds(text.replace(", ".join(effect.name for effect in CATALOGUE), "<catalogue>"))


def test_the_same_effect_twice(model, golden):
    with golden.raises(ModelError):
        with_effects(model, ["loop_delay", "loop_delay:delay=1e-5"])


def test_every_effect_of_the_catalogue_can_be_asked_for(model):
    for effect in CATALOGUE:
        if effect.parameters(model.rig):
            assert with_effects(model, [effect.name]).effects[0].name == effect.name
