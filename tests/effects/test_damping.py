"""What damps and pulls the rotor beside the magnets, against the independent simulator, without noise."""

import numpy as np
import pytest

import ambid
from ambid.effects import Seen, find
from ambid.effects.damping import ExternalDamping, InternalDamping
from ambid.effects.support import MagneticPull
from ambid.rig import PointMassRotor, Support
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS

BENCH = BENCHES["bench"]
TURNING = BENCH.rig.replace(speed=500.0)
I_E = ambid.prbs(8, amplitude=1.0, hold=3, axes=4)
CASES = {
    "whole rotor": (ExternalDamping(), {"rate": 2.5}, "external_damping", {"rate": 2.5}),
    "at a place": (ExternalDamping(0.43), {"damping": 300.0}, "external_damping", {"damping": 300.0, "z": 0.43}),
    "turning": (InternalDamping(0.43), {"damping": 300.0}, "internal_damping", {"damping": 300.0, "z": 0.43}),
    "turning, at the end": (InternalDamping(0.86), {"damping": 50.0}, "internal_damping", {"damping": 50.0, "z": 0.86}),
    "pull": (MagneticPull(0.43), {"stiffness": 3e5}, "magnetic_pull", {"stiffness": 3e5, "z": 0.43}),
}


def at_truth(rig, bench):
    truth = bench.truth
    values = {f"{kind}.{axis}": v for kind in ("K_i", "K_s") for axis, v in zip(rig.axes, truth[kind], strict=True)}
    return ambid.Model(rig).with_values({**values, "tau_e": truth["tau_e"]})


def largest_error(found, expected):
    """Of y and i_c, relative to the peak of each."""
    pairs = ((found.y, expected.y), (found.i_c, expected.i_c))
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in pairs)


@pytest.mark.parametrize("name", CASES)
def test_it_is_the_physics_that_it_says(name):
    effect, values, hidden, true = CASES[name]
    expected = simulate(TURNING, I_E, {hidden: true}, seed=None, **BENCH.truth)
    base = at_truth(TURNING, BENCH)
    assert largest_error(base.add(effect, values).simulate(I_E), expected) < 1e-8
    assert largest_error(base.simulate(I_E), expected) > 1e-4


@pytest.mark.parametrize("name", CASES)
def test_it_is_exactly_nothing_in_the_base_model(name):
    effect, values, *_ = CASES[name]
    base = at_truth(TURNING, BENCH)
    absent = base.add(effect, dict.fromkeys(values, 0.0))
    assert largest_error(absent.simulate(I_E), base.simulate(I_E)) < 1e-12


def test_damping_of_a_plain_mass():
    rig, i_e = ONE_AXIS.rig, ONE_AXIS.excitation(1.0)[:1500]
    mass = rig.rotor.mass
    expected = simulate(rig, i_e, {"external_damping": {"rate": 800.0 / mass}}, seed=None, **ONE_AXIS.truth)
    base = at_truth(rig, ONE_AXIS)
    assert largest_error(base.add("external_damping", {"damping": 800.0}).simulate(i_e), expected) < 1e-8
    assert largest_error(base.simulate(i_e), expected) > 1e-3


def test_what_is_found_can_be_written_into_the_rig_file():
    """The keys of the rig file are the same physics as the effects."""
    base = ambid.Model(TURNING)
    of_rotor = {
        ("external_damping", ExternalDamping(), "rate", 2.5): {"mass_damping": 2.5},
        ("external_damping", ExternalDamping(0.43), "damping", 300.0): {
            "support": (Support(position=0.43, damping=300.0),)
        },
        ("magnetic_pull", MagneticPull(0.43), "stiffness", 3e5): {"support": (Support(position=0.43, stiffness=-3e5),)},
    }
    for (_, effect, name, value), keys in of_rotor.items():
        known = ambid.Model(TURNING.replace(rotor=TURNING.rotor.model_copy(update=keys)))
        assert largest_error(base.add(effect, {name: value}).simulate(I_E), known.simulate(I_E)) < 1e-7


def test_where_it_is_tried():
    seen = Seen(TURNING, {})
    disks = {disk.position for disk in TURNING.rotor.disk}
    whole, *places = find("external_damping").variants(seen)
    assert whole == ExternalDamping()
    assert {own.z for own in places} == {own.z for own in find("internal_damping").variants(seen)} >= disks
    assert "external_damping" in find("internal_damping").why_not(BENCH.rig)
    assert find("external_damping").variants(Seen(ONE_AXIS.rig, {})) == (ExternalDamping(),)
    assert isinstance(ONE_AXIS.rig.rotor, PointMassRotor)
    for name in ("internal_damping", "magnetic_pull"):
        assert find(name).why_not(ONE_AXIS.rig)
        assert not find(name).parameters(ONE_AXIS.rig)


def test_damping_of_the_whole_rotor_is_told_from_that_at_a_place():
    """By the score, of a record with noise; the trait that both share is the damping of a motion without tilt."""
    rate = 4.0
    record = simulate(BENCH.rig, BENCH.excitation(BENCH.amplitude), {"external_damping": {"rate": rate}}, seed=2,
                      period=BENCH.period, **BENCH.truth)  # fmt: skip
    ranking = ambid.rank(ambid.compare(ambid.identify(BENCH.rig.exact(), record).model, record))
    best = ranking.candidates[0].effect
    assert best == ExternalDamping()
    ((trait, size),) = best.traits(BENCH.rig, {"rate": rate}).items()
    assert trait.unit == "N s/m"
    assert size == pytest.approx(rate * 69.0, rel=1e-3)
