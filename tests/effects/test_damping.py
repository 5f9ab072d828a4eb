"""What damps and pulls the rotor beside the magnets, against the independent simulator, without noise."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import ambid
from ambid.effects import Seen, find
from ambid.effects.damping import ROUNDED_RATE, ROUNDED_STATE, CoulombFriction, ExternalDamping, InternalDamping
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


@pytest.mark.slow
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


# Dry friction -------------------------------------------------------------------------------------------------------


def rounded(value, within):
    return np.sqrt(value**2 + within**2) - within


def levitator_with_friction(i_e, force, width, fastest):
    """Written out by hand, in the states x, v, i_c, i_f, integral, lagged, drawn; each sample by DOP853."""
    rig = ONE_AXIS.rig
    pid, mass, dt = rig.controller, rig.rotor.mass, 1.0 / rig.sample_rate
    (K_i,), (K_s,), tau = ONE_AXIS.K_i, ONE_AXIS.K_s, ONE_AXIS.tau_e
    e_rate, e_state = ROUNDED_RATE * fastest, ROUNDED_STATE * width

    def rate(_, state, command):
        x, v, i_c, i_f, integral, lagged, drawn = state
        lag = (x - lagged) / pid.derivative_time_constant
        feedback = pid.proportional * x + pid.integral * integral + pid.derivative * lag
        pull = K_i * i_f + K_s * x - 2.0 * force / width * drawn
        slips = (rounded(v, e_rate) * drawn + v * rounded(drawn, e_state)) / width
        to_coil = (command - feedback - i_c) / rig.amplifier.time_constant
        return [v, pull / mass, to_coil, (i_c - i_f) / tau, x, lag, v - slips]

    state, rows = np.zeros(7), []
    for command in i_e[:, 0]:
        rows.append(state[[0, 2]])
        state = solve_ivp(rate, (0.0, dt), state, args=(command,), method="DOP853", rtol=1e-11, atol=1e-15).y[:, -1]
    return np.array(rows)


def test_friction_agrees_with_scipy():
    i_e = ambid.prbs(6, amplitude=1.0, hold=4)
    force, width, fastest = 30.0, 4e-6, 1e-2
    base = at_truth(ONE_AXIS.rig, ONE_AXIS)
    rubbing = base.add(CoulombFriction(None, width, fastest), {"force": force, "inverse_width": 1.0 / width})
    expected, free = levitator_with_friction(i_e, force, width, fastest), base.simulate(i_e)
    found = rubbing.with_substeps(64).simulate(i_e)
    for ours, theirs, without in ((found.y, expected[:, :1], free.y), (found.i_c, expected[:, 1:], free.i_c)):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-6 * np.abs(theirs).max())
        assert np.abs(theirs - without).max() > 0.02 * np.abs(theirs).max()
    absent = base.add(CoulombFriction(None, width, fastest), {"force": 0.0, "inverse_width": 1.0 / width})
    np.testing.assert_allclose(absent.simulate(i_e).y, free.y, rtol=0.0, atol=1e-9 * np.abs(free.y).max())


def test_friction_is_nearly_that_of_a_slider_on_a_spring():
    """The law of the independent simulator sticks as a spring and slips all at once: a tenth of the power is left."""
    hidden = {"coulomb_friction": {"force": 20.0, "stiffness": 2e7, "z": 0.43}}
    expected = simulate(BENCH.rig, I_E, hidden, seed=None, **BENCH.truth)
    base, peak = at_truth(BENCH.rig, BENCH), np.abs(expected.y).max()

    def left(logarithms):
        force, width = np.exp(logarithms)
        model = base.add(CoulombFriction(0.43, width, 5e-3), {"force": force, "inverse_width": 1.0 / width})
        return ((model.with_substeps(16).simulate(I_E).y - expected.y) / peak).ravel()

    found = least_squares(left, np.log([20.0, 2e-6]))
    assert np.exp(found.x[0]) == pytest.approx(20.0, rel=0.15)
    assert np.sum(found.fun**2) < 0.12 * np.sum(((base.simulate(I_E).y - expected.y) / peak) ** 2)
