"""Levitators drawn at random, with slow coils and any excitation: names where something is hidden, else none."""

import pytest

from ambid import diagnose
from ambid.effects import find
from hidden.levitators import EFFECTS, levitator
from tiers import first_fast


def found(number, effect=None, size=0.0):
    machine = levitator(number)
    hidden = {effect: EFFECTS[effect][0](size, machine)} if effect else {}
    return diagnose(machine.rig, machine.record(hidden, 2), validate=machine.record(hidden, 3))


@pytest.mark.parametrize("number", first_fast([16, 3, 14]))
def test_nothing_is_named_where_nothing_is_hidden(number):
    own = found(number)
    assert own.verdict == "adequate", own


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "effect", "size"),
    [
        (14, "periodic_disturbance", 1.0),  # three periods, the hum on an excited line
        (3, "periodic_disturbance", 1.0),  # driven by noise
        (13, "foundation_resonance", 0.2),  # at 2 Hz
        (9, "sampling_skew", 1.0),  # nine tenths of a sample
    ],
)
def test_what_is_hidden_is_named_and_nothing_else(number, effect, size):
    own = found(number, effect, size)
    assert (own.verdict, own.effects) == ("explained", (effect,)), own
    assert own.history[0].misfit > 1.2
    assert own.history[-1].misfit < 1.1


@pytest.mark.slow
def test_a_dead_band_is_given_no_name_and_a_next_step():
    """The catalogue lacks it; its linear part is a gain, of which none is sure."""
    machine = levitator(64075)
    train, kept_back = (machine.record({"amplifier_dead_band": {"current": 0.0016972}}, seed) for seed in (1, 2))
    gains = ("controller_gain_error", "excitation_gain_error", "channel_gain", "amplifier_bandwidth", "flux_saturation")
    own = diagnose(machine.rig, train, validate=kept_back, catalogue=[find(name) for name in gains])
    assert (own.verdict, own.effects) == ("none_of_the_candidates", ())
    assert own.probabilities.something_else > 0.9 > 0.5 > max(own.probabilities.effects.values())
    assert own.next_steps[0].code == "next_other_amplitudes"


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "values"), [
    ("cubic_bearing_force", {"coefficient": 2.505e8}),
    ("rotor_contact", {"stiffness": 130.0, "clearance": 1.39e-4}),
])  # fmt: skip
def test_a_stop_is_held_against_a_smooth_spring_before_it_is_named(effect, values):
    """Stops with a small clearance left 3 % of what a spring that stiffens explained."""
    machine = levitator(32801)
    train, kept_back = (machine.record({effect: values}, seed) for seed in (1, 2))
    own = diagnose(machine.rig, train, validate=kept_back)
    is_named = effect == "rotor_contact"
    assert (own.verdict, own.effects) == (("explained", (effect,)) if is_named else ("none_of_the_candidates", ())), own
