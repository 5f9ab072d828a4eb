"""The truth is in the reported set: on four axes, a third of the effects that one axis lacks; rates.py has all."""

from dataclasses import replace

import pytest

from ambid.diagnosis import diagnose
from ambid.effects import find
from hidden.experiment import MACHINES, experiment, experiment_on
from hidden.families import BENCHES
from hidden.one_axis import NAMED
from hidden.one_axis import NAMELESS as NAMELESS_ON_ONE_AXIS
from hidden.physics import CATALOGUE, OUTSIDE
from hidden.sizes import sized

pytestmark = pytest.mark.slow
BEYOND_JUDGEMENT = {
    "command_quantisation": "of this size it adds noise, and nothing that repeats",
}
NAMELESS = {
    "cubic_bearing_force": ("clear", 8),
    "amplifier_dead_band": ("large", 6),
    "amplifier_asymmetry": ("clear", 6),
    "rotor_anisotropy": ("large", 8),
    "force_current_drift": ("clear", 10),
    "parametric_stiffness": ("clear", 10),
    "rate_softening": ("clear", 7),
}
"""Size and order of the PRBS: what is simulated in time costs as many samples."""


def named(found):
    return {*found.effects, *(name for names in found.ambiguous_sets for name in names)}


def hide(effects, size, order, kind="analog"):
    """An experiment on four axes with a PRBS of this order; of the benches' own, records take two seconds."""
    machine = MACHINES.get(kind, "bench")
    bench = replace(BENCHES[machine], order=order)
    return experiment_on(bench, {name: sized(name, size, machine) for name in effects}, 101, kind=kind)


@pytest.mark.parametrize("effect", [name for name in CATALOGUE if name not in NAMED][::6])
def test_a_hidden_effect_is_in_the_reported_set(effect):
    rig, train, validate, truth = hide([effect], "clear", 7)
    found = diagnose(rig, train, validate=validate)
    assert found.verdict in ("explained", "ambiguous"), found
    assert set(truth.effects) <= named(found), found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.06)
    assert found.history[-1].validation_misfit < 1.2
    values = [found.parameters[f"K_i.{axis}"].value for axis in rig.axes]
    assert values == pytest.approx(truth.K_i, rel=0.02)


def test_all_that_has_no_name_is_hidden_here():
    assert {*NAMELESS, *BEYOND_JUDGEMENT} == set(OUTSIDE)


@pytest.mark.parametrize("effect", [name for name in NAMELESS if name not in NAMELESS_ON_ONE_AXIS][:2])
def test_what_has_no_name_is_given_none(effect):
    rig, train, _, _ = hide([effect], *NAMELESS[effect])
    found = diagnose(rig, train)
    assert found.verdict == "none_of_the_candidates", found
    assert found.effects == ()


@pytest.mark.parametrize("kind", ["digital", "two_amplitudes"])
def test_nothing_hidden_is_adequate(kind):
    rig, train, _, _ = experiment(None, "clear", 101, kind=kind)
    found = diagnose(rig, train)
    assert found.verdict == "adequate", found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.05)


def test_two_at_once():
    """A delay beside a seal is in test_diagnosis."""
    pair = ("periodic_disturbance", "sensor_lag")
    rig, train, _, _ = hide(pair, "clear", 8)
    assert set(pair) <= named(diagnose(rig, train))


def test_a_large_lag_is_found_although_its_score_is_nothing():
    """The base fit takes it for a longer tau_e; where it is absent its derivative then has the wrong sign."""
    rig, train, validate, _ = hide(["sensor_lag"], "large", 8, "compressor")
    found = diagnose(rig, train, validate=validate)
    assert "sensor_lag" in named(found), found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.05)


def test_a_short_lag_that_acts_like_a_delay_may_be_either():
    """Half a microsecond, at 12.5 kHz: one number of a delay, or of a further lag, says all that is seen."""
    rig, train, validate, _ = experiment(("amplifier_bandwidth",), "clear", 500, kind="compressor")
    lags = ("amplifier_bandwidth", "loop_delay", "sampling_skew", "sensor_lag", "eddy_currents", "channel_delay")
    found = diagnose(rig, train, validate=validate, catalogue=[find(name) for name in lags])
    assert found.verdict == "ambiguous", found
    alike = {"loop_delay", "amplifier_bandwidth"}
    assert alike <= named(found) <= alike | {"sampling_skew"}, found
    assert min(found.probabilities.effects[name] for name in alike) > 0.2


def test_a_large_unbalance_does_not_hide_what_has_no_name():
    rig, train, _, _ = hide(["amplifier_asymmetry"], "clear", 7, "turning")
    few = [find(name) for name in ("unbalance", "seal_forces", "foundation_resonance", "loop_delay", "bias_asymmetry")]
    found = diagnose(rig, train, catalogue=few)
    assert found.verdict == "none_of_the_candidates", found
    assert any("unbalance" in step.effects for step in found.history)
