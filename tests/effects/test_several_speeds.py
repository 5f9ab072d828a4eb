"""What a rotor that turns at several speeds shows, and what its planes show of each other."""

from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.effects import Seen, find
from ambid.effects.disturbance import SensorRunout
from ambid.effects.rotor import Unbalance
from ambid.loop.effect import Tone
from hidden.bench import measured, simulate
from hidden.families import BENCHES

from .test_effects import at_truth, largest_error

BENCH = BENCHES["small"]
SLOW, FAST = (BENCH.rig.replace(speed=2.0 * np.pi * hz) for hz in (41.0, 97.0))


def test_unbalance_turns_with_each_of_the_speeds():
    tones = [Tone(41.02, 1, 1e3), Tone(97.01, 0, 1e3), Tone(50.0, 2, 1e3)]
    alone = find("unbalance").variants(Seen(SLOW, {}, tones))
    assert {effect.frequency_hz for effect in alone} == {41.02}, "as it was found, where there is one speed"
    seen = Seen(SLOW, {}, tones, points=(FAST,))
    assert {effect.frequency_hz for effect in find("unbalance").variants(seen)} == {None}
    hums = find("periodic_disturbance").variants(seen)
    assert {effect.frequency_hz for effect in hums} == {50.0}, "a tone at another of the speeds is no hum"


@pytest.mark.slow
def test_unbalance_is_named_from_two_speeds_together():
    """From records of a fifth of a second."""
    hidden = {"unbalance": {"mass_eccentricity": 2e-6, "z": BENCH.middle, "phase": 0.7}}
    i_e = replace(BENCH, order=7, periods=3).excitation(BENCH.amplitude, 3)
    records = [
        measured(rig, i_e, hidden, seed=10 + k, **BENCH.truth, **BENCH.noise).at(rig)
        for k, rig in enumerate((SLOW, FAST))
    ]
    few = [find(name) for name in ("unbalance", "periodic_disturbance", "gyroscopic_coupling")]
    found = ambid.diagnose(SLOW, records, catalogue=few)
    assert found.verdict == "explained"
    assert found.effects == ("unbalance",), "each record begins it at an angle of its own, which no channel shows well"
    assert found.history[-1].misfit < found.fit.bound
    assert not any(isinstance(effect, Unbalance) and effect.frequency_hz for effect in found.model.effects)


@pytest.mark.slow
@pytest.mark.parametrize("harmonic", [1, 2])
def test_runout_is_named_where_no_force_belongs_to_the_line(harmonic):
    hidden = {"sensor_runout": {"amplitude": [4e-7, 2e-7, 3e-7, 5e-7], "harmonic": harmonic, "phase": 0.7}}
    i_e = replace(BENCH, order=7, periods=5).excitation(BENCH.amplitude, 3)
    record = measured(SLOW, i_e, hidden, seed=3, **BENCH.truth, **BENCH.noise)
    like = [find(name) for name in ("sensor_runout", "periodic_disturbance", "unbalance", "gyroscopic_coupling")]
    found = ambid.diagnose(SLOW, record, catalogue=like)
    if harmonic > 1:  # at one speed a force of its own on every axis does the same
        assert found.verdict == "ambiguous", found
        assert {frozenset(names) for names in found.ambiguous_sets} == {
            frozenset(("sensor_runout", "periodic_disturbance"))
        }
        found = ambid.diagnose(SLOW, record, effects=[SensorRunout(harmonic)])
    else:
        assert (found.verdict, found.effects) == ("explained", ("sensor_runout",)), found
    values = {p.name: p.value for p in found.model.parameters}
    sizes = [np.hypot(values[f"sensor_runout.cosine_{a}"], values[f"sensor_runout.sine_{a}"]) for a in SLOW.axes]
    np.testing.assert_allclose(sizes, hidden["sensor_runout"]["amplitude"], rtol=0.1)


def test_a_rotor_that_turns_tells_the_gains_of_its_planes():
    """Which a rotor at rest leaves to K_i and K_s."""
    at_rest = find("sensor_gain_error").variants(Seen(BENCH.rig.replace(speed=0.0), {}))
    assert [effect.between_planes for effect in at_rest] == [False]
    both = find("sensor_gain_error").variants(Seen(FAST, {}))
    assert [effect.between_planes for effect in both] == [False, True]
    beside_a_seal = find("sensor_gain_error").variants(Seen(BENCH.rig.replace(speed=0.0), {}, across_planes=True))
    assert [effect.between_planes for effect in beside_a_seal] == [False, True]
    front, rear = FAST.bearings
    aligned = FAST.model_copy(update={"bearings": (front, rear.model_copy(update={"tilt": front.tilt}))})
    i_e = ambid.prbs(7, amplitude=0.2, axes=4)
    gain = {"sensor_gain_error": {"gain": [1.03, 0.97, 1.03, 0.97]}}
    truth = simulate(aligned, i_e, gain, seed=None, **BENCH.truth)
    model = at_truth(aligned, BENCH.truth).add(both[1], {"zeta": 0.0, "eta": 0.0, "planes": 0.03})
    assert largest_error(model.simulate(i_e), truth) < 1e-8
