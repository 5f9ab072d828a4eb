"""The loop room against closed forms, the full rotor, SciPy, python-control and its own promises."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag
from scipy.optimize import linear_sum_assignment

from ambid.errors import ModelError, UnstableLoopError
from ambid.loop.assembly import Lft
from ambid.loop.response import frequency_response
from ambid.rotor import assemble, reduced_rotor
from ambid.rotor.assembly import place_of
from reference.loop_rigs import (
    BENCH,
    DIGITAL,
    LEVITATOR,
    OFF,
    RIGS,
    assert_close,
    excitation,
    filled_by,
    loop_of,
    parameters,
    physical,
    rig,
)
from reference.physical_loop import by_integration
from validated import of_peak

every_rig = pytest.mark.parametrize("machine", RIGS.values(), ids=RIGS.keys())


def assert_same_poles(actual, expected, tolerance) -> None:
    """As sets, each pole relative to its own modulus."""
    distance = np.abs(actual[:, None] - expected[None, :])
    pairs = linear_sum_assignment(distance)
    assert actual.shape == expected.shape
    assert np.max(distance[pairs] / np.abs(expected[pairs[1]])) < tolerance


def close_delta(lft: Lft, theta: np.ndarray, fills: dict[str, int]) -> tuple[np.ndarray, ...]:
    """A, B, C, D of the LFT with ``w = Delta z`` put in."""
    delta = np.diag([port.scale * theta[fills[port.slot]] ** port.power for port in lft.ports])
    n_u, n_y = len(lft.inputs), len(lft.outputs)
    b_u, b_w, c_y, c_z = lft.B[:, :n_u], lft.B[:, n_u:], lft.C[:n_y], lft.C[n_y:]
    (d_yu, d_yw), (d_zu, d_zw) = (np.split(rows, [n_u], axis=1) for rows in np.split(lft.D, [n_y]))
    closed = np.linalg.solve(np.eye(len(delta)) - delta @ d_zw, delta)
    return lft.A + b_w @ closed @ c_z, b_u + b_w @ closed @ d_zu, c_y + d_yw @ closed @ c_z, d_yu + d_yw @ closed @ d_zu


# The plant and Delta --------------------------------------------------------------------------------------------------


def test_single_mass_without_controller_has_the_poles_of_its_negative_stiffness():
    machine = rig(LEVITATOR, **OFF)
    k_i, k_s, tau_e = theta = parameters(machine)
    rate = np.sqrt(k_s / machine.rotor.mass)
    expected = np.array([rate, -rate, -1.0 / tau_e, -1.0 / machine.amplifier.time_constant])
    assert_same_poles(loop_of(machine).poles(theta), expected, 1e-10)


@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_bench_without_controller_is_unstable_in_every_rigid_mode(implementation):
    machine = rig(**OFF, implementation=implementation)
    assert np.sum(loop_of(machine).poles(parameters(machine)).real > 0.0) == 4


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("speed", [0.0, 600.0])
def test_closing_delta_equals_reducing_the_full_rotor_with_its_magnets(speed, seed, validated):
    """Every freedom of the finite elements, magnets' stiffness at their nodes, then T_L (.) T_R: eqs. 4 to 8."""
    tilts = (30.0, 75.0)
    machine = rig(tilts=tilts, speed=speed, rotor={"bending_frequencies_hz": None}, **OFF)
    fills, theta = filled_by(machine), parameters(machine, spread=0.5, seed=seed)
    k_i, k_s, tau_e = (np.diag(values) for values in np.split(theta, 3))
    places = [z for b in machine.bearings for z in (b.position, b.sensor_position)]
    full, modes = assemble(machine.rotor, places), reduced_rotor(machine.rotor, places)

    def rows(key):
        freedoms = np.eye(len(full.M))
        at = {b.name: 4 * place_of(getattr(b, key), full.z) for b in machine.bearings}
        angles = [(at[b.name], np.deg2rad(b.tilt + quarter)) for b in machine.bearings for quarter in (0.0, 90.0)]
        return np.array([np.cos(angle) * freedoms[x] + np.sin(angle) * freedoms[x + 1] for x, angle in angles])

    magnet, sensor = rows("position"), rows("sensor_position")
    ratios, omega = np.tile(modes.damping, 2), np.tile(modes.frequencies_rad_s, 2)
    damping = modes.T_L.T @ np.diag(2.0 * ratios * omega) @ modes.T_L
    moved, turned, driven = (
        np.linalg.solve(full.M, m)
        for m in (magnet.T @ k_s @ magnet - full.K, -damping - speed * full.G, magnet.T @ k_i)
    )
    n, size, lag = 4, len(full.M), np.eye(4) / machine.amplifier.time_constant
    release, none = np.linalg.inv(tau_e), np.zeros
    A = np.block(
        [
            [none((size, size)), np.eye(size), none((size, 2 * n))],
            [moved, turned, none((size, n)), driven],
            [none((n, 2 * size)), -lag, none((n, n))],
            [none((n, 2 * size)), release, -release],
        ]
    )
    # the package's planes lie along zeta and eta of the first bearing
    c, s = np.cos(np.deg2rad(tilts[0])), np.sin(np.deg2rad(tilts[0]))
    turn = np.kron([[c, -s], [s, c]], np.eye(len(modes.frequencies_rad_s)))
    left = block_diag(turn.T @ modes.T_L, turn.T @ modes.T_L, np.eye(2 * n))
    right = block_diag(modes.T_R @ turn, modes.T_R @ turn, np.eye(2 * n))
    loop = loop_of(machine)
    closed = close_delta(loop.lft, theta, fills)
    expected = left @ A @ right
    validated(
        "State matrix of the plant with Delta closed: error relative to the largest entry",
        "the full finite-element rotor with its magnets' stiffness, reduced afterwards",
        (closed[0] - expected) / np.max(np.abs(expected)),
        1e-10,
    )
    coupling = left[:, size : 2 * size] @ driven  # of small numbers, so held by itself
    assert_allclose(closed[0][:, -n:][: 2 * len(omega)], coupling[: 2 * len(omega)], rtol=1e-10, atol=1e-12)
    assert_allclose(closed[2][:n, : len(omega)], sensor @ modes.T_R @ turn, rtol=1e-10, atol=1e-12)
    assert_same_poles(loop.poles(theta), np.linalg.eigvals(expected), 1e-9)


# The response ---------------------------------------------------------------------------------------------------------


@every_rig
def test_response_agrees_with_integrated_equations_of_motion(machine, validated):
    theta, u = parameters(machine), excitation(machine, 60)
    expected = physical(machine, theta).respond(u, propagate=by_integration)[:, :, 0]
    validated(
        "Response of y and i_c of analog and digital loops, at rest and turning: error relative to the peak",
        "equations of motion integrated by SciPy {scipy} (DOP853, tolerance 1e-12)",
        of_peak(loop_of(machine).simulate(theta, u), expected),
        1e-8,
    )


@every_rig
def test_response_agrees_with_the_series_of_the_equations_of_motion(machine):
    theta, u = parameters(machine), excitation(machine, 150)
    assert_close(loop_of(machine).simulate(theta, u), physical(machine, theta).respond(u)[:, :, 0], 1e-9)


@pytest.mark.parametrize("name", ["analog, rotating", "analog, rigid rotor", "analog, one axis"])
def test_analog_response_agrees_with_python_control(name, validated):
    machine = RIGS[name]
    theta, u = parameters(machine), excitation(machine, 400)
    reference = physical(machine, theta)
    k_i, k_s, tau_e = np.split(theta, 3)
    n, m = reference.magnet.shape
    zero, eye = np.zeros((m, m)), np.eye(n)
    rotor = control.ss(
        np.block([[zero, np.eye(m)], [-reference.stiffness, -reference.damping]]),
        np.vstack([0.0 * reference.magnet.T, reference.magnet.T]),
        np.hstack([np.vstack([reference.magnet, reference.sensor]), np.zeros((2 * n, m))]),
        np.zeros((2 * n, n)),
    )
    magnets = control.append(
        *(control.ss([[-1 / t]], [[1 / t]], [[k]], [[0]]) for k, t in zip(k_i, tau_e, strict=True))
    )
    lag = 1.0 / machine.amplifier.time_constant
    amplifiers = control.append(*[control.ss([[-lag]], [[lag]], [[1]], [[0]])] * n)
    pid, rate = machine.controller, 1.0 / machine.controller.derivative_time_constant
    law = control.ss([[0]], [[1]], [[pid.integral]], [[pid.proportional + pid.derivative * rate]])
    law += control.ss([[-rate]], [[rate]], [[-pid.derivative * rate]], [[0]])
    held = control.feedback(rotor, control.ss([], [], [], np.hstack([np.diag(k_s), 0.0 * eye])), sign=1)
    both = control.ss([], [], [], np.vstack([eye, eye]))
    plant = control.append(held * magnets, control.ss([], [], [], eye)) * both * amplifiers
    read = control.ss([], [], [], np.hstack([0.0 * eye, eye, 0.0 * eye]))
    loop = control.feedback(plant, control.append(*[law] * n) * read)
    sampled = control.sample_system(loop, 1.0 / machine.sample_rate, "zoh")
    expected = np.asarray(control.forced_response(sampled, inputs=u.T).outputs).reshape(3 * n, -1)[n:].T
    validated(
        "Response of y and i_c of analog loops: error relative to the peak",
        "python-control {control}: blocks in series and feedback, sampled with zero-order hold",
        of_peak(loop_of(machine).simulate(theta, u), expected),
        1e-9,
    )


# What the loop promises -----------------------------------------------------------------------------------------------


@every_rig
def test_response_is_linear_causal_and_from_rest(machine):
    loop, theta = loop_of(machine), parameters(machine)
    u, v = excitation(machine, seed=3), excitation(machine, seed=4)
    sum_of_both = 2.0 * loop.simulate(theta, u) - 3.0 * loop.simulate(theta, v)
    assert_close(loop.simulate(theta, 2.0 * u - 3.0 * v), sum_of_both, 1e-10)
    late = u.copy()
    late[:90] = 0.0
    shifted = loop.simulate(theta, late)
    assert np.all(shifted[:90] == 0.0)
    assert_close(shifted[90:], loop.simulate(theta, u[90:]), 1e-10)
    assert np.all(loop.simulate(theta, u)[0, : len(machine.axes)] == 0.0)  # no displacement before any time has passed


@every_rig
def test_simulator_equals_simulate_by_step_and_by_run(machine):
    loop, theta, u = loop_of(machine), parameters(machine), excitation(machine)
    expected, simulator = loop.simulate(theta, u), loop.simulator(theta)
    assert simulator.inputs == loop.inputs
    assert simulator.outputs == loop.outputs
    assert_close(np.array([simulator.step(row) for row in u]), expected, 1e-10)
    simulator.reset()
    assert_close(np.vstack([simulator.run(u[:71]), simulator.run(u[71:])]), expected, 1e-10)


@pytest.mark.parametrize("controller", [{}, DIGITAL], ids=["analog", "digital"])
def test_unstable_loop_runs_in_the_simulator_alone(controller):
    machine = rig(**OFF | controller)
    loop, theta, u = loop_of(machine), parameters(machine), excitation(machine, 100)
    growth = np.exp(np.max(loop.poles(theta).real) / machine.sample_rate)
    with pytest.raises(UnstableLoopError) as caught:
        loop.simulate(theta, u)
    assert f"{growth:.6f}" in str(caught.value)
    with pytest.raises(UnstableLoopError):
        loop.sensitivity(theta, u, [0])
    # without feedback the controller's kind makes no difference
    assert_close(loop.simulator(theta).run(u), physical(rig(**OFF), theta).respond(u)[:, :, 0], 1e-8)


NOISY = [
    "analog, rotating",
    "analog, one axis",
    "digital",
    "digital, delay 1, rotating",
    "digital, delay 0.5, one axis",
]


@pytest.mark.parametrize("name", NOISY)
def test_sensor_noise_goes_round_the_loop_by_the_sensitivity_function(name, validated):
    """Spectrum of the response to one pulse of noise, long enough to die out."""
    machine, samples = RIGS[name], 120_000
    loop, theta, n = loop_of(machine, noise=True), parameters(machine), len(machine.axes)
    reference = physical(machine, theta)
    assert loop.inputs[n:] == tuple(f"n.{axis}" for axis in machine.axes)
    bins = np.array([120, 1200, 6600, 18_000, 48_000])
    for axis in range(n):
        pulse = np.zeros((samples, 2 * n))
        pulse[0, n + axis] = 1.0
        y = loop.simulate(theta, pulse)[:, :n]
        assert np.max(np.abs(y[-1])) < 1e-10
        spectrum = np.fft.rfft(y, axis=0)[bins]
        omega = 2.0 * np.pi * machine.sample_rate / samples * bins
        expected = np.array([reference.sensitivity_function(w)[:, axis] for w in omega])
        validated(
            "Sensor noise round the loop: error of the sensitivity function, which tends to 1",
            "(I + P K)^-1 from the equations of motion",
            spectrum - expected,
            1e-8,
        )


@pytest.mark.parametrize("name", ["analog", "digital, delay 1.5, twice the rate"])
def test_excitation_and_noise_act_together(name):
    machine = RIGS[name]
    theta, u = parameters(machine), excitation(machine)
    noise = 1e-6 * excitation(machine, seed=5)
    y = loop_of(machine, noise=True).simulate(theta, np.hstack([u, noise]))
    assert_close(y, physical(machine, theta).respond(u, noise)[:, :, 0], 1e-9)


@pytest.mark.parametrize("controller", [{}, DIGITAL], ids=["analog", "digital"])
def test_planes_part_at_rest_and_join_when_the_rotor_turns(controller):
    rest, turning = rig(**controller), rig(speed=1.0, **controller)
    assert loop_of(rest).core.parts == 2
    assert loop_of(turning).core.parts == 1
    crossed = rig(tilts=(30.0, 75.0), **controller)
    assert loop_of(crossed).core.parts == 1


@pytest.mark.parametrize("speed", [0.0, 600.0])
def test_turning_all_bearings_together_changes_nothing(speed):
    """The rotor is the same in every plane."""
    first, second = rig(tilts=(0.0, 20.0), speed=speed), rig(tilts=(-100.0, -80.0), speed=speed)
    theta, u = parameters(first), excitation(first)
    assert_close(loop_of(second).simulate(theta, u), loop_of(first).simulate(theta, u), 1e-10)


def test_sampled_matrices_give_the_response():
    machine = RIGS["digital, delay 1.5, twice the rate"]
    loop, theta, u = loop_of(machine), parameters(machine), excitation(machine)
    a, b, c, d = loop.state_space(theta)
    x, rows = np.zeros(len(a)), []
    for row in u:
        rows.append(c @ x + d @ row)
        x = a @ x + b @ row
    assert_close(np.array(rows), loop.simulate(theta, u), 1e-10)
    poles = loop.poles(theta)
    assert np.all(np.diff(poles.real) <= 0.0)
    assert_allclose(np.exp(poles.real[0] / machine.sample_rate), np.max(np.abs(np.linalg.eigvals(a))), rtol=1e-10)


# What it refuses ------------------------------------------------------------------------------------------------------


def spoiled(values: np.ndarray, place, value: float) -> np.ndarray:
    copy = values.copy()
    copy[place] = value
    return copy


THETA, U = parameters(BENCH), excitation(BENCH)
WRONG = {
    "theta too short": (THETA[:5], U),
    "theta of two axes": (THETA[None], U),
    "theta NaN": (spoiled(THETA, 3, np.nan), U),
    "theta infinite": (spoiled(THETA, 3, np.inf), U),
    "tau_e zero": (spoiled(THETA, 9, 0.0), U),
    "u of one axis": (THETA, U[:, 0]),
    "u too narrow": (THETA, U[:, :3]),
    "u NaN": (THETA, spoiled(U, (17, 2), np.nan)),
}


@pytest.mark.parametrize(("theta", "u"), WRONG.values(), ids=WRONG.keys())
def test_wrong_arrays_are_refused_with_their_numbers(theta, u, golden):
    loop, messages = loop_of(BENCH), set()
    for refuse in (loop.simulate, lambda *own: loop.sensitivity(*own, [0]), lambda *own: loop.simulator(theta).run(u)):
        with pytest.raises(ModelError) as caught:
            refuse(theta, u)
        messages.add(str(caught.value))
    (message,) = messages
    golden.holds(message)


@pytest.mark.parametrize("index", [-1, 12])
def test_parameter_that_does_not_exist_is_refused(index, golden):
    with golden.raises(ModelError):
        loop_of(BENCH).sensitivity(THETA, U, [0, index])


def test_step_refuses_a_wrong_row_and_stays_where_it_was(golden):
    simulator = loop_of(BENCH).simulator(THETA)
    before = simulator.run(U[:50])
    for row in (U[50, :2], U[50] * np.nan, U):
        with golden.raises(ModelError):
            simulator.step(row)
    assert_close(np.vstack([before, simulator.run(U[50:])]), loop_of(BENCH).simulate(THETA, U), 1e-10)


def test_arguments_are_not_changed():
    theta, u = THETA.copy(), U.copy()
    loop_of(BENCH).sensitivity(theta, u, [0])
    loop_of(BENCH).simulator(theta).run(u)
    assert np.array_equal(theta, THETA)
    assert np.array_equal(u, U)


def test_frequency_response_does_not_depend_on_the_units_of_states():
    rng = np.random.default_rng(3)
    A, B, C, D = (
        rng.standard_normal((5, 5)) - 4.0 * np.eye(5),
        *(rng.standard_normal(s) for s in ((5, 2), (3, 5), (3, 2))),
    )
    points = 2j * np.pi * np.geomspace(0.01, 10.0, 7)
    expected = np.array([C @ np.linalg.solve(p * np.eye(5) - A, B) + D for p in points])
    unit = 10.0 ** np.array([-45.0, 45.0, 0.0, 9.0, -3.0])
    scaled = (A * unit[:, None] / unit, B * unit[:, None], C / unit, D)
    for system in ((A, B, C, D), scaled):
        assert_allclose(frequency_response(system, points), expected, rtol=1e-11)
