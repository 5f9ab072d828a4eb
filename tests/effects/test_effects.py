"""Every effect of the catalogue against an independent simulation of the same physics, without noise."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import ambid
from ambid import prbs
from ambid.effects import CATALOGUE, Effect, Seen, find
from ambid.effects.amplifier import AmplifierVoltageLimit, LoopDelay
from ambid.effects.disturbance import PeriodicDisturbance, SensorRunout
from ambid.effects.magnet import half_derivative
from ambid.effects.rotor import Unbalance
from ambid.errors import ModelError
from ambid.loop.delay import pade, with_late_commands
from ambid.loop.effect import EffectParameter
from ambid.loop.loop import open_plant
from ambid.loop.response import frequency_response
from ambid.rig import Rig
from hidden.bench import measured, simulate
from hidden.families import BENCHES, voltage_driven
from hidden.long import LONG
from hidden.one_axis import ONE_AXIS
from validated import relative

TRUTH = BENCHES["bench"].truth
# name: hidden physics, our parameters, agreement relative to the peak
AGREE = {
    "bending_mode_shift": (
        {"frequency_factor": 1.01},
        {"squared_frequency_1": 1.01**2 - 1.0, "damping_1": 0.01 * 0.004},
        1e-9,
    ),
    "rotor_inertia_error": ({"mass_factor": 1.03, "inertia_factor": 1.05}, {"mass": 0.03, "inertia": 0.05}, 1e-9),
    "seal_forces": (
        {"z": 0.43, "direct": 8e5, "cross": 6e5, "damping": 300.0},
        {"direct_stiffness": 8e5, "cross_stiffness": 6e5, "damping": 300.0},
        1e-9,
    ),
    "coupling_stiffness": ({"stiffness": 2e5, "damping": 50.0}, {"stiffness": 2e5, "damping": 50.0}, 1e-9),
    "foundation_resonance": (
        {"frequency_hz": 130.0, "damping": 0.04, "mass_kg": 400.0},
        {"frequency_hz": 130.0, "damping": 0.04, "inverse_mass": 1.0 / 400.0},
        1e-9,
    ),
    "eddy_currents": ({"tau": 1e-6}, {"root_time_constant": 1e-3}, 1e-4),
    "axis_cross_coupling": ({"fraction": 0.05}, {"share_A": 0.05, "share_B": 0.05}, 1e-9),
    "amplifier_bandwidth": ({"frequency_hz": 1100.0, "damping": 0.45}, {"frequency_hz": 1100.0, "damping": 0.45}, 1e-9),
    "loop_delay": ({"seconds": 5e-5}, {"delay": 5e-5}, 1e-4),
    "sensor_lag": ({"tau": 3e-5}, {"time_constant": 3e-5}, 1e-9),
    "sensor_gain_error": ({"gain": [1.03, 1.02, 0.97, 0.98]}, {"zeta": 0.03, "eta": 0.02}, 1e-9),
    "sensor_misalignment": ({"degrees": [2.0, -1.0]}, {"angle_A": 2.0, "angle_B": -1.0}, 1e-6),
    "sensor_position_error": ({"dz": [5e-3, -3e-3]}, {"offset_A": 5e-3, "offset_B": -3e-3}, 1e-6),
    "sampling_skew": ({"seconds": 1e-5}, {"current_late": 1e-5}, 1e-3),
    "back_emf": ({"coefficient": 5.0}, {"current_per_velocity": 5.0}, 1e-9),
    "force_nonlinearity": ({}, {"bias_ratio": 1.0}, 1e-6),
    "amplifier_voltage_limit": ({"slew": 8000.0}, {"inverse_slew_rate": 1.0 / 8000.0, "noise": 40.0}, 1e-3),
}


@pytest.fixture(scope="module")
def i_e():
    return ambid.prbs(8, amplitude=1.0, hold=3, axes=4, periods=2)


def at_truth(rig: Rig, truth: dict = TRUTH) -> ambid.Model:
    values = {f"{kind}.{axis}": v for kind in ("K_i", "K_s") for axis, v in zip(rig.axes, truth[kind], strict=True)}
    return ambid.Model(rig).with_values({**values, "tau_e": truth["tau_e"]})


def largest_error(found: ambid.Record, expected: ambid.Record) -> float:
    """Of y and i_c, relative to the peak of each signal."""
    pairs = ((found.y, expected.y), (found.i_c, expected.i_c))
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in pairs)


@pytest.mark.parametrize("name", AGREE)
def test_effect_is_the_physics_that_it_says(rig, i_e, name, validated):
    hidden, values, tolerance = AGREE[name]
    if name == "sensor_misalignment":
        values = {key: np.deg2rad(value) for key, value in values.items()}
    truth = simulate(rig, i_e, {name: hidden}, seed=None, **TRUTH)
    absent = {p.name: values.get(p.name, 0.0) for p in find(name).parameters(rig)}
    base = at_truth(rig)
    model = base.add(name, absent)
    without, with_it = largest_error(base.simulate(i_e), truth), largest_error(model.simulate(i_e), truth)
    validated(
        "Effects of the catalogue in y and i_c, each by itself: error relative to the peak",
        "independent simulator in C, fixed steps",
        with_it,
        tolerance,
    )
    assert without > 5.0 * with_it, "the effect must show"


@pytest.mark.parametrize("kind", ["other lag", "further lag"])
def test_an_amplifier_with_one_number(rig, i_e, kind):
    """Another first-order lag than the rig's, or a second one in series with that."""
    known, own = rig.amplifier.time_constant, 3e-5
    omega = 1.0 / np.sqrt(known * own)
    second_order = {"frequency_hz": omega / (2.0 * np.pi), "damping": 0.5 * (known + own) * omega}
    hidden, name = {"other lag": ({"time_constant": known + own}, "time_constant")}.get(
        kind, (second_order, "further_lag")
    )
    truth = simulate(rig, i_e, {"amplifier_bandwidth": hidden}, seed=None, **TRUTH)
    base, value = at_truth(rig), known + own if kind == "other lag" else own
    effect = replace(find("amplifier_bandwidth"), kind=kind)
    assert largest_error(base.add(effect, {name: value}).simulate(i_e), truth) < 1e-9
    assert largest_error(base.simulate(i_e), truth) > 1e-3


@pytest.mark.parametrize(
    ("name", "hidden", "probed"),
    [("amplifier_voltage_limit", {"slew": 9000.0}, 1.0 / 9000.0), ("command_saturation", {"level": 1.9}, 1.0 / 1.9)],
)
def test_a_limit_that_is_hardly_reached_is_as_sharp_as_it_is(rig, i_e, name, hidden, probed):
    """Within a hundredth of the little that it changes: what a rounded corner misses has been called another effect."""
    own = replace(find(name), probed=probed)
    truth = simulate(rig, i_e, {name: hidden}, seed=None, longest_step=1e-6, **TRUTH)
    base = at_truth(rig)
    changed = truth.outputs - base.simulate(i_e).outputs
    missed = base.add(own, {own.size: probed, "noise": 0.004 / probed}).simulate(i_e).outputs - truth.outputs
    assert 1e-4 < np.linalg.norm(changed) / np.linalg.norm(truth.outputs) < 0.1
    assert np.linalg.norm(missed) < 0.01 * np.linalg.norm(changed)


def test_noise_of_the_loop_rounds_the_corners_of_a_limit():
    """Noise with a seventh of the limit leaves nothing beside a rounded one, and as much again beside a sharp one."""
    limit, noise = 0.9, {"sensor_noise": 3e-7, "current_noise": 2e-3}
    hidden, i_e = {"command_saturation": {"level": limit}}, ONE_AXIS.excitation(0.4)
    record = measured(ONE_AXIS.rig, i_e, hidden, seed=3, **ONE_AXIS.truth, **noise)
    model = ambid.Model(ONE_AXIS.rig).add("command_saturation", {"inverse_limit": 1.0 / limit})
    rounded = ambid.identify(model, record)
    sharp = ambid.identify(model, record, fixed={"command_saturation.noise": 0.004})
    assert sharp.misfit > 1.2 > 1.03 > rounded.misfit
    assert 1.0 / rounded["command_saturation.inverse_limit"].value == pytest.approx(limit, rel=0.03)


TURNED = {"zeta": 0.03, "eta": 0.02, "planes": 0.01}
QUARTER = {"zeta": 0.03, "eta": 0.02}
MANY = {"zeta": 0.03, "eta": -0.02} | {
    f"{b}_{a}": 0.01 * k for k, (b, a) in enumerate((("C", "eta"), ("D", "zeta")), 1)
}


@pytest.mark.parametrize(
    ("machine", "tilt", "gain", "values"),
    [
        ("small", 30.0, [1.04, 1.01, 0.98, 0.97], TURNED),
        ("small", 135.0, [1.04, 1.01, 0.98, 0.97], TURNED),
        ("small", 90.0, [1.03, 1.02, 0.98, 0.97], QUARTER),
        ("small", -180.0, [1.03, 1.02, 0.97, 0.98], QUARTER),
        ("four_bearings", 45.0, [1.03, 0.98, 0.97, 1.02, 1.0, 1.01, 1.02, 1.0], MANY),
    ],
)
def test_gains_of_sensors_of_any_bearings(machine, tilt, gain, values):
    """Turned against each other, by right angles, or more than two of them: all that K_i does not absorb."""
    bench = {**BENCHES, **LONG}[machine]
    *others, last = bench.rig.bearings
    turned = bench.rig.model_copy(update={"bearings": (*others, last.model_copy(update={"tilt": tilt}))})
    i_e = prbs(7, amplitude=0.2, axes=len(turned.axes))
    truth = simulate(turned, i_e, {"sensor_gain_error": {"gain": gain}}, seed=None, **bench.truth)
    absent = {p.name: values.get(p.name, 0.0) for p in find("sensor_gain_error").parameters(turned)}
    assert set(values) <= set(absent)
    base = at_truth(turned, bench.truth)
    assert largest_error(base.add("sensor_gain_error", absent).simulate(i_e), truth) < 1e-8
    assert largest_error(base.simulate(i_e), truth) > 1e-3


@pytest.mark.parametrize(("tilt", "determined"), [(0.0, 2), (90.0, 2), (30.0, 3)])
def test_gains_of_sensors_are_what_no_stiffness_absorbs(tilt, determined):
    """The slopes of the response by them are no combination of those by K_i, K_s and tau_e, and all others are."""
    rig = BENCHES["small"].rig
    front, rear = rig.bearings
    base = ambid.Model(rig.model_copy(update={"bearings": (front, rear.model_copy(update={"tilt": tilt}))}))
    i_e = prbs(7, amplitude=0.2, axes=4)
    single = [base.add(SingleGain(axis), {"g": 0.0}) for axis in base.rig.axes]
    many = base.add("sensor_gain_error", {p.name: 0.0 for p in find("sensor_gain_error").parameters(base.rig)})

    def slopes(model, own):
        u = np.hstack([i_e, np.zeros((len(i_e), len(model.loop.inputs) - 4))])
        found = model.loop.sensitivity(model.theta, u, own)[1].reshape(-1, len(own))
        return found / np.linalg.norm(found, axis=0)

    known = slopes(base, range(9))
    gains = np.hstack([slopes(model, [9]) for model in single])
    free = gains - known @ np.linalg.lstsq(known, gains)[0]
    assert np.sum(np.linalg.svd(free, compute_uv=False) > 1e-6) == determined
    assert len(many.names) - 9 == determined
    both = np.hstack([known, slopes(many, range(9, 9 + determined))])
    assert np.linalg.norm(gains - both @ np.linalg.lstsq(both, gains)[0]) < 1e-6


@dataclass(frozen=True)
class SingleGain(Effect):
    """One sensor that reads too large."""

    axis: str = ""
    name = "single_gain"

    def parameters(self, rig):
        return [EffectParameter("g", "1", 0.01)]

    def attach(self, plant):
        plant.inject(f"y.{self.axis}", plant.port(self.slot("g"), plant.raw(f"y.{self.axis}"), scale=1.0))


@pytest.mark.parametrize("speed", [0.0, 600.0])
@pytest.mark.parametrize("share", [1.0, 0.4])
def test_omitted_bending_modes_come_back(rig, i_e, speed, share, validated):
    """As computed, and with shapes that are smaller, which count twice, in the force and in what is seen of it."""
    rigid = rig.replace(rotor=rig.rotor.model_copy(update={"flexible_modes": 0}), speed=speed)
    hidden = {"rotor_bending_mode": {"count": 2, "participation": share}}
    truth = simulate(rigid, i_e, hidden, seed=None, **TRUTH)
    own = {f"participation_{k}": share**2 for k in (1, 2)}
    model = at_truth(rigid).add("rotor_bending_mode", own)
    validated(
        "Bending modes added to a rigid model, at rest and at 600 rad/s: error relative to the peak",
        "independent simulator in C, with these modes",
        largest_error(model.simulate(i_e), truth),
        1e-6,
    )
    assert largest_error(at_truth(rigid).simulate(i_e), truth) > 1e-2 * share**2
    absent = at_truth(rigid).add("rotor_bending_mode", dict.fromkeys(own, 1e-9))
    assert largest_error(absent.simulate(i_e), at_truth(rigid).simulate(i_e)) < 1e-6


def test_gyroscopic_factor(rig, i_e, validated):
    turning = rig.replace(speed=1000.0)
    truth = simulate(turning, i_e, {"gyroscopic_coupling": {"factor": 1.3}}, seed=None, **TRUTH)
    model = at_truth(turning).add("gyroscopic_coupling", {"factor": 0.3})
    validated(
        "Gyroscopic moments 1.3 times those of the finite elements at 1000 rad/s: error relative to the peak",
        "independent simulator in C",
        largest_error(model.simulate(i_e), truth),
        1e-8,
    )
    assert find("gyroscopic_coupling").parameters(rig) == [], "no gyroscopic moments at rest"


def periods_of(rig: Rig, record: ambid.Record) -> ambid.Record:
    return ambid.Record("bench", rig.sample_rate, rig.axes, record.i_e, record.y, record.i_c, period=765)


@pytest.mark.parametrize("z", [0.43, None])
def test_unbalance_is_the_physics_that_it_says(rig, i_e, z, validated):
    """In one plane at its place, or in the planes of the bearings; the angle is counted from a displacement."""
    turning = rig.replace(speed=200.0)
    hidden = {"unbalance": {"mass_eccentricity": 1e-4, "z": 0.43, "phase": 0.7}}
    truth = periods_of(rig, simulate(turning, i_e, hidden, seed=None, **TRUTH))
    base = at_truth(turning)
    found = disturbed(base, Unbalance(z), truth)
    total = np.hypot(found[::2].sum(), found[1::2].sum())
    validated(
        "Unbalance by mass and eccentricity: relative error of its size by least squares",
        "independent simulator in C",
        total / 1e-4 - 1.0,
        0.02,
    )


@pytest.mark.parametrize("port", ["current", "force"])
def test_periodic_disturbance_is_the_physics_that_it_says(rig, i_e, port):
    hidden = {"periodic_disturbance": {"frequency_hz": 57.3, "amplitude": 0.1, "port": port, "axis": 1, "phase": 0.4}}
    truth = periods_of(rig, simulate(rig, i_e, hidden, seed=None, **TRUTH))
    found = disturbed(at_truth(rig), PeriodicDisturbance(57.3, port, 1, 1), truth)
    assert np.hypot(*found) == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("harmonic", [1, 3])
def test_runout_is_the_physics_that_it_says(rig, i_e, harmonic):
    turning, sizes = rig.replace(speed=200.0), [1e-6, 2e-6, 0.5e-6, 1.5e-6]
    hidden = {"sensor_runout": {"amplitude": sizes, "harmonic": harmonic, "phase": 0.7}}
    truth = periods_of(rig, simulate(turning, i_e, hidden, seed=None, **TRUTH))
    found = disturbed(at_truth(turning), SensorRunout(harmonic), truth)
    # the wave is held over a sample, so that an analog controller reads it half a sample late
    np.testing.assert_allclose(np.hypot(found[::2], found[1::2]), sizes, rtol=0.02)


def test_a_disturbance_where_there_is_nothing_is_refused(rig, golden):
    base = at_truth(rig)
    named, counted = (base.add(PeriodicDisturbance(50.0, "current", axis)).loop.lft for axis in ("B_zeta", 2))
    np.testing.assert_array_equal(named.B, counted.B)
    with golden.raises(ModelError):
        _ = base.add(PeriodicDisturbance(50.0, "current", "B_zeat")).loop
    with golden.raises(ModelError):
        _ = base.add(PeriodicDisturbance(50.0, "volts")).loop


def disturbed(base: ambid.Model, effect: Effect, truth: ambid.Record) -> np.ndarray:
    """Amplitudes of a disturbance by least squares of y after the first period; the rest of it must be nothing."""
    own = [p.name for p in effect.parameters(base.rig)]
    responses = []
    for name in [None, *own]:
        values = {p: float(p == name) for p in own}
        model = base.add(effect, values)
        y = model.loop.simulate(model.theta, model.excitation(truth))[truth.period :, : len(base.rig.axes)]
        responses.append(y.ravel())
    table = np.column_stack(responses[1:]) - responses[0][:, None]
    left = truth.y[truth.period :].ravel() - responses[0]
    found = np.linalg.lstsq(table, left, rcond=None)[0]
    assert np.abs(left - table @ found).max() < 0.05 * np.abs(left).max()
    return found


@pytest.mark.parametrize(
    "effect",
    [own for own in CATALOGUE if own.parameters(BENCHES["bench"].rig.replace(speed=800.0))],
    ids=lambda effect: effect.name,
)
def test_sensitivities_of_effects(rig, i_e, effect):
    """Against central differences of the response, every parameter of every effect."""
    rig = rig if effect.parameters(rig) else rig.replace(speed=800.0)
    rig = rig if effect.parameters(rig) else voltage_driven(rig)
    effect = AmplifierVoltageLimit(1.5e-4) if effect.name == "amplifier_voltage_limit" else effect
    parameters = effect.parameters(rig)
    model = at_truth(rig).add(effect).with_substeps(32)
    u = np.hstack([i_e[:300], effect.waveform(rig, 300, None)])
    for k, p in enumerate(parameters, start=len(model.names) - len(parameters)):
        _, jacobian = model.loop.sensitivity(model.theta, u, [k])
        step = 1e-4 * p.probe
        high, low = model.theta, model.theta
        high[k] += step
        low[k] -= step
        difference = (model.loop.simulate(high, u) - model.loop.simulate(low, u)) / (2.0 * step)
        peak = np.abs(difference).max(axis=0)
        size = np.abs(model.loop.simulate(model.theta, u)).max(axis=0) / p.probe
        assert (peak > 1e-7 * size).any(), f"{effect.name}.{p.name} does nothing"
        seen = peak > 1e-5 * size
        error = np.abs(jacobian[:, :, 0] - difference).max(axis=0)
        assert (error[seen] < 1e-3 * peak[seen]).all(), p.name


def under(rig: Rig, implementation: str, derivative: float) -> Rig:
    """A controller that leaves room for a delay; a digital one has some of its own."""
    own: dict = {"derivative": derivative}
    if implementation == "digital":
        own |= {"implementation": "digital", "sample_rate": 2e4, "delay_samples": 0.3}
    return rig.replace(controller=type(rig.controller)(**{**rig.controller.model_dump(), **own}))


@pytest.mark.parametrize(
    ("implementation", "seconds", "step", "tolerance"),
    [
        # the reference of an analog loop has steps of its own, of second order
        *(("analog", seconds, 5e-7, 1e-7) for seconds in (3e-6, 47e-6, 100e-6, 150e-6)),
        *(("digital", seconds, 1e-5, 1e-12) for seconds in (3e-6, 47e-6, 100e-6)),
    ],
)
def test_a_delay_is_exact(rig, implementation, seconds, step, tolerance, validated):
    """Within a sample of 100 us, a whole one, and longer; the digital controller has a delay of its own."""
    rig = under(rig, implementation, 40.0)
    i_e = ambid.prbs(6, amplitude=1.0, hold=2, axes=4)
    truth = simulate(rig, i_e, {"loop_delay": {"seconds": seconds}}, seed=None, longest_step=step, **TRUTH)
    model = at_truth(rig).add("loop_delay", {"delay": seconds})
    validated(
        "Delays of any length, analog and digital: error relative to the peak",
        "independent simulator in C, delay held in a buffer of fine steps",
        largest_error(model.simulate(i_e), truth),
        tolerance,
    )
    stepped = model.simulator().run(i_e)
    assert np.abs(stepped[:, :4] - truth.y).max() < tolerance * np.abs(truth.y).max()
    assert model.decay_rate > 1.0


@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_a_delay_beside_a_nonlinear_effect(rig, i_e, implementation):
    rig = under(rig, implementation, 45.0)
    truth = simulate(rig, i_e, {"force_nonlinearity": {}, "loop_delay": {"seconds": 3.3e-5}}, seed=None, **TRUTH)
    model = at_truth(rig).add("force_nonlinearity", {"bias_ratio": 1.0}).add("loop_delay", {"delay": 3.3e-5})
    assert largest_error(model.simulate(i_e), truth) < 1e-4
    (late,) = model.index(["loop_delay.delay"])
    jacobian = model.loop.sensitivity(model.theta, i_e, [late])[1][:, :, 0]
    step = np.zeros(len(model.theta))
    step[late] = 1e-8
    ahead, behind = (model.loop.simulate(model.theta + sign * step, i_e) for sign in (1.0, -1.0))
    np.testing.assert_allclose(jacobian, (ahead - behind) / 2e-8, atol=2e-5 * np.abs(jacobian).max())


def test_two_delays_of_one_thing_are_refused(rig, golden):
    class Cable(LoopDelay):
        name = "cable"

    with golden.raises(ModelError):
        ambid.Model(rig).add("loop_delay").add(Cable()).loop  # noqa: B018


def test_a_late_excitation_in_the_frequency_response(rig):
    """At frequencies below 1/delay, where a Pade approximant of everything on the way is as good."""
    model = at_truth(rig).add("loop_delay", {"delay": 3e-5})
    f = np.array([20.0, 150.0, 400.0])
    after = model.loop.frequency_response(model.theta, f)
    plant = with_late_commands(open_plant(rig, model.effects)).closed(
        {slot: p.value for p in model.parameters for slot in p.slots}
    )
    s = 2j * np.pi * f
    P = frequency_response(plant, s)[:, :, :4]
    K = frequency_response(rig.controller.state_space(4, rig.sample_rate), s)
    expected = P @ np.linalg.inv(np.eye(4) + K @ P[:, :4])
    np.testing.assert_allclose(after, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


def test_pade_is_a_delay():
    a, b, c = pade(6)
    s = 1j * np.linspace(0.01, 1.0, 50)
    response = np.array([(c @ np.linalg.solve(x * np.eye(6) - a, b)).item() for x in s])
    np.testing.assert_allclose(response, np.exp(-s) - 1.0, atol=1e-12)


def test_half_derivative(validated):
    poles, weights = half_derivative()
    s = 1j * np.geomspace(5.0, 5e4, 80)
    response = (weights * s[:, None] / (s[:, None] + poles)).sum(axis=1)
    validated(
        "Half-order lag of eddy currents as a sum of first-order ones, 0.8 Hz to 8 kHz: relative error",
        "sqrt(s)",
        relative(response, np.sqrt(s)),
        3e-4,
    )


def test_mistakes_are_named(rig, golden):
    model = ambid.Model(rig)
    with golden.raises(ModelError):
        model.add("loop_lag")
    with golden.raises(ModelError):
        model.add("loop_delay", {"tau": 1e-5})
    with golden.raises(ModelError):
        model.add("loop_delay").add("loop_delay")
    with golden.raises(ModelError):
        model.add("gyroscopic_coupling")
    with golden.raises(ModelError):
        model.without("seal_forces")


def test_effects_survive_saving(tmp_path, rig, i_e):
    seal = next(variant for variant in find("seal_forces").variants(Seen(rig, {})) if variant.settings() == {"z": 0.26})
    model = at_truth(rig).add(seal).add("loop_delay")
    model.save(tmp_path / "model.json")
    again = ambid.Model.load(tmp_path / "model.json")
    assert again.names == model.names
    np.testing.assert_array_equal(again.simulate(i_e).y, model.simulate(i_e).y)
    assert again.without("loop_delay").without("seal_forces").names == ambid.Model(rig).names
