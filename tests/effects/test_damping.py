"""What damps and pulls the rotor beside the magnets, against the independent simulator, without noise."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import ambid
from ambid.effects import Seen, find
from ambid.effects.damping import CoulombFriction, ExternalDamping, InternalDamping
from ambid.effects.hysteresis import ROUNDED_RATE, ROUNDED_STATE, SHARPEST
from ambid.effects.magnet import MagneticHysteresis
from ambid.effects.support import MagneticPull
from ambid.rig import PointMassRotor, Support
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS
from validated import of_peak

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
def test_it_is_the_physics_that_it_says(name, validated):
    effect, values, hidden, true = CASES[name]
    expected = simulate(TURNING, I_E, {hidden: true}, seed=None, **BENCH.truth)
    base = at_truth(TURNING, BENCH)
    validated(
        "Damping to ground, internal damping and magnetic pull at 500 rad/s: error relative to the peak",
        "independent simulator in C",
        largest_error(base.add(effect, values).simulate(I_E), expected),
        1e-8,
    )
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
    assert find("external_damping").variants(Seen(ONE_AXIS.rig, {})) == [ExternalDamping()]
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


def levitator_with_friction(i_e, force, width, n, fastest):
    """Written out by hand, in the states x, v, i_c, i_f, integral, lagged, drawn; each sample by DOP853."""
    rig = ONE_AXIS.rig
    pid, mass, dt = rig.controller, rig.rotor.mass, 1.0 / rig.sample_rate
    (K_i,), (K_s,), tau = ONE_AXIS.K_i, ONE_AXIS.K_s, ONE_AXIS.tau_e
    e_rate = ROUNDED_RATE * fastest

    def rate(_, state, command):
        x, v, i_c, i_f, integral, lagged, drawn = state
        lag = (x - lagged) / pid.derivative_time_constant
        feedback = pid.proportional * x + pid.integral * integral + pid.derivative * lag
        h = 2.0 / width * drawn
        size = np.hypot(h, ROUNDED_STATE)
        pull = K_i * i_f + K_s * x - force * h
        grown = size**n if size < 1.0 else 1.0 + n * (size - 1.0)
        slips = rounded(v * h / size, e_rate) * grown * h / size
        to_coil = (command - feedback - i_c) / rig.amplifier.time_constant
        return [v, pull / mass, to_coil, (i_c - i_f) / tau, x, lag, v - slips]

    state, rows = np.zeros(7), []
    for command in i_e[:, 0]:
        rows.append(state[[0, 2]])
        state = solve_ivp(rate, (0.0, dt), state, args=(command,), method="DOP853", rtol=1e-11, atol=1e-15).y[:, -1]
    return np.array(rows)


@pytest.mark.parametrize("n", [1.0, 5.0])
def test_friction_agrees_with_scipy(n, validated):
    i_e = ambid.prbs(6, amplitude=1.0, hold=4)
    force, width, fastest = 30.0, 4e-6, 1e-2
    base = at_truth(ONE_AXIS.rig, ONE_AXIS)
    loop = {"inverse_width": 1.0 / width, "inverse_exponent": 1.0 / n}
    rubbing = base.add(CoulombFriction(None, width, fastest), loop | {"force": force})
    expected, free = levitator_with_friction(i_e, force, width, n, fastest), base.simulate(i_e)
    found = rubbing.with_substeps(64).simulate(i_e)
    for ours, theirs, without in ((found.y, expected[:, :1], free.y), (found.i_c, expected[:, 1:], free.i_c)):
        validated(
            "Dry friction in a closed loop: error relative to the peak",
            "six equations written out by hand, integrated by SciPy {scipy} (DOP853, tolerance 1e-11)",
            of_peak(ours, theirs),
            1e-6,
        )
        assert np.abs(theirs - without).max() > 0.02 * np.abs(theirs).max()
    absent = base.add(CoulombFriction(None, width, fastest), loop | {"force": 0.0})
    np.testing.assert_allclose(absent.simulate(i_e).y, free.y, rtol=0.0, atol=1e-9 * np.abs(free.y).max())


def left_of(hidden, begin, effect_of):
    """Part of what hidden physics does to y and i_c that an effect leaves, and its parameters fitted to that."""
    expected = simulate(BENCH.rig, I_E, hidden, seed=None, **BENCH.truth)
    base = at_truth(BENCH.rig, BENCH)

    def missed(model):
        found = model.with_substeps(16).simulate(I_E)
        pairs = ((found.y, expected.y), (found.i_c, expected.i_c))
        return np.hstack([((a - b) / np.abs(b).max(axis=0)).ravel() for a, b in pairs])

    def of(p):
        return base.add(effect_of, dict(zip(begin, [*np.exp(p[:2]), p[2]], strict=True)))

    start = [*np.log(list(begin.values())[:2]), 0.3]
    bounds = ([-25.0, -25.0, 1.0 / SHARPEST], [15.0, 20.0, 1.0])
    found = least_squares(lambda p: missed(of(p)), start, bounds=bounds, x_scale=0.1, max_nfev=25)
    values = [*np.exp(found.x[:2]), found.x[2]]
    return np.sum(found.fun**2) / np.sum(missed(base) ** 2), dict(zip(begin, values, strict=True))


SLIDERS = [(2.0, 2e7), (20.0, 2e7), (200.0, 2e7), (20.0, 2e6)]


@pytest.mark.parametrize(("force", "stiffness"), SLIDERS)
@pytest.mark.parametrize("dahl", [False, True])
def test_friction_is_that_of_a_slider_on_a_spring_and_of_dahl(force, stiffness, dahl):
    """Both by the independent simulator, whose slider slips all at once; at a place in two planes, where Dahl's law
    slips a little otherwise."""
    hidden = {"coulomb_friction": {"force": force, "stiffness": stiffness, "z": 0.43, "dahl": dahl}}
    begin = {"force": force, "inverse_width": 0.5 * stiffness / force, "inverse_exponent": 0.3}
    left, found = left_of(hidden, begin, CoulombFriction(0.43, 2.0 * force / stiffness, 5e-3))
    assert left < (CoulombFriction.formula_error if dahl else 1e-3)
    if not dahl:
        assert found["force"] == pytest.approx(force, rel=0.02)
        assert found["inverse_width"] == pytest.approx(0.5 * stiffness / force, rel=0.1)


@pytest.mark.parametrize("width", [0.05, 0.2, 0.5, 2.0])
def test_hysteresis_is_nearly_that_of_plays_in_parallel(width):
    begin = {"share": 0.1, "inverse_width": 1.0 / width, "inverse_exponent": 0.3}
    left, _ = left_of({"magnetic_hysteresis": {"share": 0.1, "width": width}}, begin, MagneticHysteresis(width, 3e3))
    assert left < MagneticHysteresis.formula_error


def test_friction_does_not_know_the_axes():
    """Turned by 30 degrees, motion of the plane meets the same force along it."""
    loop = {"force": 20.0, "inverse_width": 5e5, "inverse_exponent": 0.2}
    turned = BENCH.rig.replace(bearings=[b.model_copy(update={"tilt": b.tilt + 30.0}) for b in BENCH.rig.bearings])
    rubbing = [at_truth(rig, BENCH).add(CoulombFriction(0.43, 2e-6, 5e-3), loop) for rig in (BENCH.rig, turned)]
    straight, other = (model.with_substeps(16).simulate(I_E) for model in rubbing)
    np.testing.assert_allclose(other.y, straight.y, rtol=0.0, atol=1e-6 * np.abs(straight.y).max())
