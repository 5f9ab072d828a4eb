"""The generator of hidden physics against closed forms, an integrator of SciPy, limits, and the measured cases."""

import json
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

from ambid.excitation import prbs
from ambid.noise.window import Window
from ambid.record import Record
from ambid.rig import Rig
from places import SHARED
from reference.whitening import Whitening

from .bench import MachineFailure, simulate, simulate_all
from .experiment import KINDS, experiment
from .families import AT_SPEED, BENCHES, FAMILIES
from .laws import half_order, magnet
from .network import MEMORY, compiler, law, library
from .one_axis import ONE_AXIS
from .physics import CATALOGUE, OUTSIDE, settle
from .sizes import TARGETS, score, sized

pytestmark = pytest.mark.skipif(compiler() is None, reason="hidden records need a C compiler (cc, gcc or clang)")
CASES = SHARED / "cases"

BENCH = BENCHES["bench"]
TRUE = BENCH.truth
QUIET = {**TRUE, "seed": None}
SHORT = prbs(7, amplitude=1.0, hold=3, axes=4, periods=2)

LEVITATOR = ONE_AXIS.rig
MASS, TAU = LEVITATOR.rotor.mass, LEVITATOR.actuator.time_constant
(K_I,), (K_S,) = LEVITATOR.bearings[0].force_current, LEVITATOR.bearings[0].force_displacement
ALONE = {"K_i": K_I, "K_s": K_S, "tau_e": TAU, "seed": None}


def turned(rig, **changes):
    return rig.replace(controller=rig.controller.model_copy(update=changes))


def digital(rig, **changes):
    return turned(rig, implementation="digital", **changes)


# Closed forms ---------------------------------------------------------------------------------------------------------


def test_a_force_at_one_frequency_moves_the_levitator_as_the_closed_form_says():
    hum = {"frequency_hz": 80.0, "amplitude": 20.0, "port": "force", "phase": 0.4}
    record = simulate(LEVITATOR, np.zeros((2000, 1)), {"periodic_disturbance": hum}, **ALONE, warm_up=2.0)
    s, pid = 2j * np.pi * 80.0, LEVITATOR.controller
    control = pid.proportional + pid.integral / s + pid.derivative * s / (pid.derivative_time_constant * s + 1.0)
    lag = 1.0 / (1e-4 * s + 1.0)
    y = 1.0 / (MASS * s**2 - K_S + K_I * control * lag / (TAU * s + 1.0))
    wave = 20.0 * np.exp(1j * (2.0 * np.pi * 80.0 * record.t + 0.4))
    assert_allclose(record.y[:, 0], (y * wave).imag, atol=1e-7 * np.abs(y * 20.0))
    assert_allclose(record.i_c[:, 0], (-control * lag * y * wave).imag, atol=1e-7 * np.abs(control * y * 20.0))


def test_currents_carry_the_weight():
    record = simulate(BENCH.rig, np.zeros((10, 4)), gravity=9.81, **QUIET)
    angle = np.deg2rad(45.0)
    force = np.array(BENCH.K_i) * record.i_c[-1]
    up = force @ np.tile([np.sin(angle), np.cos(angle)], 2)
    aside = force @ np.tile([np.cos(angle), -np.sin(angle)], 2)
    assert_allclose(up, 69.0 * 9.81, rtol=2e-3)  # K_s s is small, since the sensors are close to the magnets
    assert abs(aside) < 1e-2
    assert np.abs(record.y).max() < 1e-12


def test_half_order_lag_is_met_within_1e_4():
    s = 2j * np.pi * np.geomspace(0.1, 2e4, 3000)
    for tau in (1e-9, 1e-7, 1e-5, 1e-3):
        poles, weights, constant = half_order(tau)
        fitted = constant + (weights * poles / (s[:, None] + poles)).sum(axis=1)
        assert np.abs(fitted - 1.0 / (1.0 + np.sqrt(tau * s))).max() < 1e-4, tau
        assert_allclose(constant + weights.sum(), 1.0, rtol=1e-12)


# Another integrator ---------------------------------------------------------------------------------------------------


def levitator_by_scipy(i_e, level):
    """The levitator with a saturating magnet, written out by hand, in the states x, v, i_c, i_f, integral, lagged."""
    pid, gap = LEVITATOR.controller, 4.0 * K_I / K_S
    beta = lambda x: np.tanh(level * x) / level  # noqa: E731
    slope = 1.0 / np.cosh(level) ** 2
    scale = K_I * 4.0 / (4.0 * beta(1.0) * slope)

    def rate(_, state, command):
        x, v, i_c, i_f, integral, lagged = state
        feedback = pid.proportional * x + pid.integral * integral
        feedback += pid.derivative * (x - lagged) / pid.derivative_time_constant
        plus, minus = (1.0 + i_f / 4.0) / (1.0 - x / gap), (1.0 - i_f / 4.0) / (1.0 + x / gap)
        force = scale * (beta(plus) ** 2 - beta(minus) ** 2)
        lag = (x - lagged) / pid.derivative_time_constant
        return [v, force / MASS, (command - feedback - i_c) / 1e-4, (i_c - i_f) / TAU, x, lag]

    state, rows = np.zeros(6), []
    for command in i_e[:, 0]:
        rows.append(state[[0, 2]])
        state = solve_ivp(rate, (0.0, 1e-4), state, args=(command,), method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
    return np.array(rows)


def test_a_saturating_magnet_agrees_with_scipy_and_converges():
    i_e = prbs(5, amplitude=1.0, hold=4, periods=2)
    reference = levitator_by_scipy(i_e, 0.8)
    hidden, errors = {"flux_saturation": {"level": 0.8, "curve": "tanh"}}, []
    for step in (20e-6, 10e-6):
        record = simulate(LEVITATOR, i_e, hidden, **ALONE, warm_up=0.0, longest_step=step)
        error = np.hstack([record.y, record.i_c]) - reference
        errors.append((np.abs(error).max(axis=0) / np.abs(reference).max(axis=0)).max())
    assert errors[1] < 1e-5
    assert 3.5 < errors[0] / errors[1] < 4.5
    linear = simulate(LEVITATOR, i_e, **ALONE, warm_up=0.0)
    assert np.abs(linear.y[:, 0] - reference[:, 0]).max() > 0.01 * np.abs(reference[:, 0]).max()


@pytest.mark.parametrize("delay", [0.3e-6, 47.3e-6, 230e-6])
def test_a_delay_off_the_grid_is_exact(delay):
    """Held apart from its own steps: the same delay on steps of which it is another fraction."""
    rig = turned(BENCH.rig, derivative=50.0)
    coarse, fine = (
        simulate(rig, SHORT, {"loop_delay": {"seconds": delay}}, **QUIET, longest_step=h) for h in (10e-6, 1.7e-6)
    )
    assert_allclose(coarse.y, fine.y, atol=2e-5 * np.abs(fine.y).max())
    assert_allclose(coarse.i_c, fine.i_c, atol=2e-5 * np.abs(fine.i_c).max())


def test_a_loop_delay_is_a_delay_of_the_digital_controller():
    fast = {"sample_rate": 2e4}
    known = simulate(digital(BENCH.rig, delay_samples=0.37, **fast), SHORT, **QUIET)
    hidden = simulate(digital(BENCH.rig, **fast), SHORT, {"loop_delay": {"seconds": 0.37 / 2e4}}, **QUIET)
    assert_allclose(hidden.y, known.y, rtol=1e-9, atol=1e-15)
    fine = simulate(digital(BENCH.rig, delay_samples=0.37, **fast), SHORT, {"back_emf": {"coefficient": 0.0}}, **QUIET)
    assert_allclose(fine.y, known.y, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("turn", [1, -1])
def test_skewed_currents_are_those_of_another_instant(turn):
    double = BENCH.rig.replace(sample_rate=2e4)
    both = simulate(double, np.repeat(SHORT, 2, axis=0), **QUIET)
    skewed = simulate(BENCH.rig, SHORT, {"sampling_skew": {"seconds": turn * 5e-5}}, **QUIET)
    shifted = both.i_c[1::2] if turn > 0 else np.vstack([np.zeros((1, 4)), both.i_c[1:-1:2]])
    assert_allclose(skewed.y, both.y[::2], atol=1e-9 * np.abs(both.y).max())
    assert_allclose(skewed.i_c, shifted, atol=1e-5 * np.abs(both.i_c).max())


# Limits ---------------------------------------------------------------------------------------------------------------

NOTHING = {
    "rotor_bending_mode": {"count": 0},
    "bending_mode_shift": {},
    "rotor_inertia_error": {},
    "gyroscopic_coupling": {"factor": 1.0},
    "unbalance": {"mass_eccentricity": 0.0, "z": 0.43},
    "seal_forces": {"z": 0.43},
    "coupling_stiffness": {"stiffness": 0.0},
    "external_damping": {"z": 0.43},
    "internal_damping": {"damping": 0.0, "z": 0.43},
    "magnetic_pull": {"stiffness": 0.0, "z": 0.43},
    "foundation_resonance": {"frequency_hz": 100.0, "mass_kg": np.inf},
    "force_nonlinearity": {"share": 0.0},
    "eddy_currents": {"tau": 0.0},
    "magnetic_hysteresis": {"share": 0.0},
    "axis_cross_coupling": {"fraction": 0.0},
    "amplifier_bandwidth": {"time_constant": 2e-4},
    "amplifier_voltage_limit": {"slew": 1e9},
    "loop_delay": {"seconds": 0.0},
    "sensor_lag": {"tau": 0.0},
    "sensor_gain_error": {"gain": 1.0},
    "sensor_misalignment": {"degrees": 0.0},
    "sensor_position_error": {"dz": 0.0},
    "sampling_skew": {"seconds": 0.0},
    "back_emf": {"coefficient": 0.0},
    "periodic_disturbance": {"frequency_hz": 50.0, "amplitude": 0.0},
    "cubic_bearing_force": {"coefficient": 0.0},
    "rotor_contact": {"stiffness": 0.0, "clearance": 1e-5},
    "inductance_error": {"error": 0.0, "gap_part": 0.0},
    "coulomb_friction": {"force": 0.0, "z": 0.43},
    "amplifier_dead_band": {"current": 0.0},
    "amplifier_asymmetry": {"fraction": 0.0},
    "sensor_nonlinearity": {},
    "bias_asymmetry": {"bias": 0.0},
    "command_saturation": {"level": 1e6},
    "sensor_runout": {"amplitude": 0.0},
    "command_quantisation": {"step": 1e-12},
    "rotor_anisotropy": {"frequency_factor": 1.0},
    "force_current_drift": {"fraction": 0.0},
    "parametric_stiffness": {"stiffness": 0.0},
    "rate_softening": {"knee": np.inf},
}


def test_every_effect_can_be_nothing_but_saturation():
    assert {*CATALOGUE, *OUTSIDE} - set(NOTHING) == {"flux_saturation"}


@pytest.mark.parametrize("effect", NOTHING)
def test_an_effect_of_no_size_is_no_effect(effect):
    rig = BENCH.known_to((effect,)) if effect in AT_SPEED else BENCH.rig
    none, zero = simulate_all(
        [{"rig": rig, "i_e": SHORT, "hidden": h, **QUIET} for h in ({}, {effect: NOTHING[effect]})]
    )
    assert_allclose(zero.y, none.y, rtol=1e-9, atol=1e-9 * np.abs(none.y).max())
    assert_allclose(zero.i_c, none.i_c, rtol=1e-9, atol=1e-9 * np.abs(none.i_c).max())


def test_hardly_saturated_iron_is_the_square_law():
    squared, saturated = (
        simulate(BENCH.rig, SHORT, h, **QUIET)
        for h in ({"force_nonlinearity": {}}, {"flux_saturation": {"level": 1e-3, "curve": "tanh"}})
    )
    assert_allclose(saturated.y, squared.y, atol=1e-5 * np.abs(squared.y).max())


@pytest.mark.parametrize(("level", "curve"), [(0.0, "tanh"), (0.7, "tanh"), (0.9, "blend")])
def test_small_signal_gains_of_the_force_laws_are_the_true_ones(level, curve):
    numbers = magnet(K_I, K_S, 4.0, level, curve)
    i, s = 1e-4, 1e-8
    added = [law("magnet", numbers, [i, 0.0]) / i / K_I, law("magnet", numbers, [0.0, s]) / s / K_S]
    assert_allclose(added, 0.0, atol=1e-6)  # what the law adds to K_i i + K_s s
    assert_allclose(law("magnet", numbers, [-1.0, -5e-5]), -law("magnet", numbers, [1.0, 5e-5]), rtol=1e-12)
    assert (law("magnet", numbers, [3.0, 0.0]) < 0.0) == (level > 0.0)


def test_the_iron_curves_start_with_slope_1_and_end_at_1():
    for kind in (1, 2):
        assert_allclose(library().iron(kind, 1e-3), 1e-3, rtol=1e-5)
        assert_allclose(library().iron(kind, 1e3), 1.0, rtol=1e-3)
        assert_allclose(library().iron(kind, 0.01), -library().iron(kind, -0.01))


def test_a_stop_all_round_pushes_back_and_knows_no_axes():
    for u in ([3e-5, 1e-5], [-1e-5, 2e-5], [0.5e-5, 0.2e-5]):
        r = np.hypot(*u)
        force = [law("contact", [1e6, 1e-5], u), law("contact", [1e6, 1e-5], u[::-1])]
        assert_allclose(force, -1e6 * max(r - 1e-5, 0.0) * np.array(u) / r)
        assert_allclose(law("contact", [1e6, 1e-5, 1.0], u), force[0] / r)


def test_a_slider_and_dahl_hold_with_their_force_against_the_way_that_is_gone():
    for dahl in (0.0, 1.0):
        memory, force = np.zeros(MEMORY), []
        for s in np.linspace(0.0, 1e-4, 20_000):
            force = [law("friction", [3.0, 2e6, dahl], [0.8 * s, 0.6 * s], memory=memory)]
        assert_allclose(force, -2.4, rtol=1e-9)


def test_hysteresis_and_friction_do_not_know_the_rate_and_take_energy():
    for name, numbers in (("hysteresis", [0.2, 0.5]), ("friction", [3.0, 2e3]), ("friction", [3.0, 2e3, 1.0])):
        areas = []
        for points in (400, 4000):
            memory, z = np.zeros(MEMORY), np.sin(np.linspace(0.0, 4.0 * np.pi, 2 * points + 1))
            f = np.array([law(name, numbers, [v], memory=memory) for v in z])[points:]
            areas.append(-np.sum((f[1:] + f[:-1]) / 2.0 * np.diff(z[points:])))
        assert areas[0] > 0.0, name  # work that the port takes out over a cycle
        assert_allclose(areas[0], areas[1], rtol=5e-3)


def test_sizes_grow_from_barely_to_large_and_exist_for_every_effect():
    assert set(FAMILIES) == {*CATALOGUE, *OUTSIDE}
    for bench in BENCHES:
        for effect in FAMILIES:
            found = [sized(effect, size, bench) for size in TARGETS]
            settle({effect: found[0].parameters})
            assert all(a.score < b.score for a, b in pairwise(found)), effect


@pytest.mark.slow
def test_stored_scores_are_those_of_the_machine():
    for effect in ("loop_delay", "cubic_bearing_force"):
        stored = sized(effect, "clear")
        assert_allclose(score(BENCH, {effect: stored.parameters}, stored.amplitude), stored.score, rtol=0.05)


# Records --------------------------------------------------------------------------------------------------------------


def test_every_effect_moves_the_record():
    jobs = []
    for effect in FAMILIES:
        rig, large = BENCH.known_to((effect,)), sized(effect, "large")
        louder = 3.0 if effect == "command_saturation" else 1.0  # a short sequence has lower peaks
        more = {**QUIET, "rig": rig, "i_e": louder * large.amplitude * SHORT}
        jobs += [{**more, "hidden": {}}, {**more, "hidden": {effect: large.parameters}}]
    records = simulate_all(jobs)
    for effect, none, record in zip(FAMILIES, records[::2], records[1::2], strict=True):
        change = np.hstack([record.y - none.y, (record.i_c - none.i_c) * 1e-5])
        assert np.abs(change).max() > 1e-8, effect


def test_effects_combine():
    hidden = {effect: sized(effect, "clear").parameters for effect in FAMILIES if effect != "rotor_bending_mode"}
    record = simulate(BENCH.rig.replace(speed=200.0), 0.3 * SHORT, hidden, **TRUE, seed=3, gravity=9.81, warm_up=0.1)
    assert np.isfinite(record.y).all()


def test_noise_goes_round_the_loop_and_adds_to_the_response():
    noisy, noise, clean = (
        simulate(BENCH.rig, i_e, **TRUE, seed=seed) for i_e, seed in ((SHORT, 5), (0.0 * SHORT, 5), (SHORT, None))
    )
    assert_allclose(noisy.y - noise.y, clean.y, atol=1e-9 * np.abs(clean.y).max())
    white = simulate(BENCH.rig, 0.0 * SHORT, **TRUE, seed=5, current_noise=0.0)
    assert 1.02 < white.y.std() / 50e-9 < 3.0
    assert white.i_c.std() > 1e-3
    assert_array_equal(white.y, noise.y)


def test_many_at_once_are_the_same_as_one_by_one():
    jobs = [{"rig": BENCH.rig, "i_e": SHORT, **TRUE, "seed": seed} for seed in range(4)]
    for one, many in zip([simulate(**job) for job in jobs], simulate_all(jobs), strict=True):
        assert_array_equal(one.y, many.y)
        assert_array_equal(one.i_c, many.i_c)


def test_what_cannot_be_is_refused(golden):
    with pytest.raises(MachineFailure):
        simulate(BENCH.rig, SHORT, {"loop_delay": {"seconds": 2e-3}}, **QUIET)
    with golden.raises(ValueError):
        simulate(BENCH.rig, SHORT, {"magic": {}}, **QUIET)
    with golden.raises(ValueError):
        simulate(BENCH.rig, SHORT, {"sensor_lag": {"tau": 1e-5, "gain": 2}}, **QUIET)
    with golden.raises(ValueError):
        simulate(BENCH.rig, SHORT, {"sensor_lag": {}}, **QUIET)


@pytest.mark.parametrize("kind", KINDS)
def test_experiments_of_every_kind(kind):
    rig, train, validate, truth = experiment("sensor_lag", "clear", 1, kind=kind)
    assert "sensor_lag" in truth.effects
    assert truth.verdict == "explained"
    for record in (*train, *validate):
        assert record.seconds > 1.8
        assert (record.i_c is None) == (kind == "without_i_c")
        checked = Record.from_arrays(
            y=record.y, i_e=record.i_e, i_c=record.i_c, axes=record.axes, sample_rate=record.sample_rate, rig=rig
        )
        assert checked.period == record.period
    assert len(train) == (2 if kind == "two_amplitudes" else 1)
    assert not np.array_equal(train[0].i_e, validate[0].i_e)


HIDDEN = {
    "01-nothing-missing": {},
    "02-bending-mode": {"rotor_bending_mode": {"count": 2}},
    "03-loop-delay": {"loop_delay": {"seconds": 50e-6}},
    "05-amplifier-order": {"amplifier_bandwidth": {"frequency_hz": 1100.0, "damping": 0.45}},
    "06-seal": {"seal_forces": {"z": 0.43, "direct": 8e5, "cross": 6e5, "damping": 300.0}},
    "08-not-in-the-catalogue": {"cubic_bearing_force": {"coefficient": 1.5e15}},
}


@pytest.mark.skipif(
    not CASES.is_dir(), reason="the measured cases are not here; set AMBID_SHARED to the folder above theirs"
)
@pytest.mark.parametrize("case", HIDDEN)
def test_the_measured_cases_are_reproduced_down_to_their_noise(case):
    truth = json.loads((CASES / "answers.json").read_text())[case]
    rig = Rig.load(CASES / case / "rig.toml")
    record = Record.load(next((CASES / case).glob("train.*")), rig)
    true = {name: truth[name] for name in ("K_i", "K_s", "tau_e")}
    clean = simulate(rig, record.i_e, HIDDEN[case], **true, seed=None, warm_up=0.0)
    residual = np.hstack([record.y - clean.y, record.i_c - clean.i_c])
    white = Whitening.between(residual, Window.of(record).settled).white(residual)
    assert abs(np.mean(white**2) - 1.0) < 0.06  # without the loop's shape
    fit = 100.0 * (1.0 - np.linalg.norm(residual[:, :4], axis=0) / np.linalg.norm(record.y - record.y.mean(0), axis=0))
    assert_allclose(fit, truth["fits"]["train"]["floor_y"], atol=0.02)
    twin = simulate(rig, record.i_e, HIDDEN[case], **true, seed=1, warm_up=0.0)
    noise = np.hstack([twin.y - clean.y, twin.i_c - clean.i_c])
    assert_allclose(noise.std(axis=0), residual.std(axis=0), rtol=0.05)
