"""Digital loops whose plant has inputs beyond the commands, against SciPy, by the linear and the nonlinear path."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ambid import _core
from ambid.errors import ModelError
from ambid.loop.plant import Plant
from ambid.rig import Rig
from ambid.rotor import reduced_rotor
from reference import nonlinear_loop
from reference.loop_rigs import CROSSED, DIGITAL, filled_by, parameters, rig

MACHINE = rig(**CROSSED, **DIGITAL | {"delay_samples": 1.5, "sample_rate": 2e4})
AXES, DISTURBANCES, STEPS = 4, 2, 2


class Disturbed:
    """A rig's plant with two forces that push its modes and noise of the sensors, under its digital controller."""

    def __init__(self, machine: Rig = MACHINE) -> None:
        places = [z for b in machine.bearings for z in (b.position, b.sensor_position)]
        plant = Plant(machine, reduced_rotor(machine.rotor, places))
        for d, pushes in enumerate(({0: 1.0, 3: -0.5}, {1: 2.0, 2: 0.3, 4: 1.0})):
            force = plant.input(f"d.{d}")
            for k, factor in pushes.items():
                plant.inject(f"modal_force.{k}", factor * force)
        for axis in machine.axes:
            plant.inject(f"y.{axis}", plant.input(f"n.{axis}"))
        self.lft = plant.between_commands_and_outputs()
        fills = filled_by(machine)
        self.gains = [(fills[port.slot], port.scale, port.power) for port in self.lft.ports]
        self.dt = 1.0 / machine.sample_rate
        self.theta = parameters(machine)
        matrices = machine.controller.state_space(len(machine.axes), machine.sample_rate)
        self.digital = {"matrices": matrices, "delay": machine.controller.delay_samples, "steps": STEPS}

    @property
    def matrices(self) -> tuple[np.ndarray, ...]:
        return self.lft.A, self.lft.B, self.lft.C, self.lft.D

    def core(self) -> _core.ClosedLoop:
        matrices = tuple(np.ascontiguousarray(m) for m in self.matrices)
        return _core.ClosedLoop(matrices, self.gains, len(self.theta), self.dt, self.digital)

    def linear_core_with_a_block(self) -> _core.ClosedLoop:
        """The same loop by way of the nonlinear path: its force law has no strength."""
        A, B, C, D = self.matrices
        slots = [port.slot for port in self.lft.ports]
        k_i, k_s = slots.index("K_i.A_zeta"), slots.index("K_s.A_zeta")
        n_u, n_y = len(self.lft.inputs), len(self.lft.outputs)
        matrices = (A, np.c_[B, B[:, n_u + k_i]], np.r_[C, C[[n_y + k_i, n_y + k_s]]], np.pad(D, ((0, 2), (0, 1))))
        constants = {"bias": 6.0, "nu": 0.0}
        block = {"law": "force_law", "curve": "unsaturated", "parameters": {"K_i": 0, "K_s": 4}, "constants": constants}
        return _core.ClosedLoop(matrices, self.gains, len(self.theta), self.dt, self.digital, [block], 4)

    def reference(self, theta: np.ndarray, u: np.ndarray, propagate) -> np.ndarray:
        return respond(close(self.matrices, self.gains, theta), self.digital, self.dt, u, propagate)


def close(matrices, gains, theta, blocks=()):
    """A, B, C, D with the gains closed; `blocks`, by their signals, stay: w after the inputs, z after the outputs."""
    A, B, C, D = matrices
    k, n_w, signals = len(gains), len(blocks), sum(blocks)
    u, w = [*range(B.shape[1] - k - n_w), *range(B.shape[1] - n_w, B.shape[1])], slice(-k - n_w, B.shape[1] - n_w)
    y, z = [*range(len(C) - k - signals), *range(len(C) - signals, len(C))], slice(-k - signals, len(C) - signals)
    delta = np.diag([scale * theta[index] ** power for index, scale, power in gains])
    delta = np.linalg.solve(np.eye(k) - delta @ D[z, w], delta)
    back = B[:, w] @ delta, D[y, w] @ delta
    return A + back[0] @ C[z], B[:, u] + back[0] @ D[z, u], C[y] + back[1] @ C[z], D[np.ix_(y, u)] + back[1] @ D[z, u]


def by_expm(A, B, x, u, duration):
    """Exact, and right for complex numbers."""
    n = len(A)
    whole = transition(np.hstack([A, B]).tobytes(), A.dtype, n, duration)
    return whole[:n, :n] @ x + whole[:n, n:] @ u


@lru_cache(maxsize=8)
def transition(matrices, dtype, n, duration):
    """The exponential of [A, B; 0, 0] over an interval, found once for all its samples."""
    above = np.frombuffer(matrices, dtype).reshape(n, -1)
    m = above.shape[1] - n
    return expm(duration * np.vstack([above, np.zeros((m, n + m))]))


def by_integration(A, B, x, u, duration):
    return solve_ivp(lambda _, x: A @ x + B @ u, (0.0, duration), x, "DOP853", rtol=1e-12, atol=1e-17).y[:, -1]


def respond(matrices, digital, dt, u, propagate):
    """Outputs from rest; u is excitation and further inputs. `propagate(A, B, x, u, duration)` moves the plant."""
    A, B, C, D = matrices
    a, b, c, d = digital["matrices"]
    m, step = len(d), dt / digital["steps"]
    whole, fraction = divmod(digital["delay"], 1.0)
    whole, late = int(whole), int(fraction > 0.0)
    x, state = np.zeros(len(A), dtype=A.dtype), np.zeros(len(a), dtype=A.dtype)
    commands = [np.zeros(m, dtype=A.dtype)] * (whole + 2)  # newest first
    rows = []
    for excitation, further in zip(u[:, :m], u[:, m:], strict=True):
        for turn in range(digital["steps"]):
            read = C[:m] @ x + D[:m, m:] @ further
            commands = [excitation - c @ state - d @ read, *commands[:-1]]
            state = a @ state + b @ read
            first = np.concatenate([commands[whole + late], further])
            if turn == 0:
                rows.append(C @ x + D @ first)
            if late:
                x = propagate(A, B, x, first, fraction * step)
            x = propagate(A, B, x, np.concatenate([commands[whole], further]), (1.0 - fraction) * step)
    return np.array(rows)


def loud(samples: int, seed: int = 3) -> np.ndarray:
    """Random steps of every input, in amperes, newtons and metres."""
    sizes = np.repeat([1.0, 50.0, 1e-6], [AXES, DISTURBANCES, AXES])
    return sizes * np.random.default_rng(seed).choice([-1.0, 1.0], (samples, len(sizes)))


def assert_close(found, expected, tolerance, axis=0):
    """Within `tolerance` of the peak of each column."""
    peak = np.max(np.abs(expected), axis=axis)
    assert found.shape == expected.shape
    assert np.all(peak > 0.0)
    assert np.max(np.abs(found - expected) / peak) < tolerance


@pytest.fixture(params=["linear", "nonlinear"])
def core(request) -> _core.ClosedLoop:
    loop = Disturbed()
    return loop.core() if request.param == "linear" else loop.linear_core_with_a_block()


def test_response_agrees_with_an_integrator(core):
    loop, u = Disturbed(), loud(50)
    assert core.inputs == u.shape[1]
    assert_close(core.simulate(loop.theta, u), loop.reference(loop.theta, u, by_integration), 1e-8)


def test_response_and_slopes_agree_with_complex_steps(core):
    loop, u = Disturbed(), loud(80)
    y, slopes = core.sensitivity(loop.theta, list(range(len(loop.theta))), u)
    assert_close(y, loop.reference(loop.theta, u, by_expm), 1e-9)
    for j, value in enumerate(loop.theta):
        moved = loop.theta.astype(complex)
        moved[j] += 1e-20j * value
        expected = loop.reference(moved, u, by_expm).imag / (1e-20 * value)
        assert_close(slopes[:, :AXES, j], expected[:, :AXES], 1e-8, axis=None)
        assert_close(slopes[:, AXES:, j], expected[:, AXES:], 1e-8, axis=None)


def test_every_input_acts_alone_and_in_its_place(core):
    loop, u = Disturbed(), loud(40)
    whole = core.simulate(loop.theta, u)
    parts = np.zeros_like(whole)
    for j in range(u.shape[1]):
        alone = np.zeros_like(u)
        alone[:, j] = u[:, j]
        y = core.simulate(loop.theta, alone)
        assert_close(y, loop.reference(loop.theta, alone, by_expm), 1e-9)
        parts += y
    assert_close(parts, whole, 1e-10)


def test_stepper_and_normal_equations_take_the_same_inputs(core):
    loop, u = Disturbed(), loud(150)
    y, slopes = core.sensitivity(loop.theta, [0, 5, 9], u)
    assert_close(_core.Stepper(core, loop.theta).run(u), y, 1e-10)
    weights = 1.0 / np.std(y, axis=0)
    z = y + np.random.default_rng(1).standard_normal(y.shape) / weights
    hessian, gradient, _ = _core.normal_equations(core, loop.theta, [0, 5, 9], [_core.Data(core, u, z, weights)])
    slopes = weights[:, None] * (slopes - slopes.mean(axis=0))
    residual = weights * ((y - z) - (y - z).mean(axis=0))
    np.testing.assert_allclose(hessian, np.einsum("koi,koj->ij", slopes, slopes), rtol=1e-8)
    np.testing.assert_allclose(gradient, np.einsum("koi,ko->i", slopes, residual), rtol=1e-6)


def test_a_disturbance_of_both_planes_couples_nothing():
    at_rest = Disturbed(rig(**DIGITAL | {"delay_samples": 1.5, "sample_rate": 2e4}))
    assert at_rest.core().parts == 2
    u = loud(60)
    assert_close(at_rest.core().simulate(at_rest.theta, u), at_rest.reference(at_rest.theta, u, by_expm), 1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("channel", [0, AXES, -1], ids=["excitation", "disturbance", "noise"])
def test_inputs_that_are_not_finite_are_refused(core, channel, bad):
    theta, u = Disturbed().theta, loud(20)
    u[7, channel] = bad
    stepper = _core.Stepper(core, theta)
    for refuse in (
        lambda: core.simulate(theta, u),
        lambda: core.sensitivity(theta, [0], u),
        lambda: stepper.step(u[7]),
        lambda: stepper.run(u),
        lambda: _core.Data(core, u, np.zeros((20, core.outputs)), np.ones(core.outputs)),
    ):
        with pytest.raises(ModelError) as caught:
            refuse()
        assert "excitation" in str(caught.value)


# A strongly nonlinear loop --------------------------------------------------------------------------------------------


class Levitated:
    """The saturating magnet of the nonlinear tests, pushed by a force and with a displacement that is read in error."""

    def __init__(self, **loop) -> None:
        plant = nonlinear_loop.KINDS["tanh"](**loop)
        A, B, C, D = plant.matrices
        force, error = np.zeros(len(A)), np.zeros(len(C))
        force[1], error[0] = 1.0 / nonlinear_loop.MASS, 1.0
        # after the command; the error is read, and goes to the block as if the magnet saw it
        error[6] = 0.3
        B = np.insert(B, 1, [force, np.zeros(len(A))], axis=1)
        D = np.insert(D, 1, [np.zeros(len(C)), error], axis=1)
        self.matrices, self.plant, self.theta = (A, B, C, np.ascontiguousarray(D)), plant, plant.theta
        self.gains = [(0, 1.0, 1), (1, 1.0, 1), (2, 1.0, -1)]
        self.digital = plant.digital

    def core(self) -> _core.ClosedLoop:
        blocks = self.plant.blocks
        return _core.ClosedLoop(self.matrices, self.gains, len(self.theta), nonlinear_loop.DT, self.digital, blocks, 8)

    def reference(self, theta, u):
        A, B, C, D = close(self.matrices, self.gains, theta, blocks=[2])
        law = self.plant.laws[0]

        def propagate(_, __, x, u, duration):
            def rate(_, x):
                return A @ x + B[:, :-1] @ u + B[:, -1] * law(theta, C[2:] @ x + D[2:, :-1] @ u)

            return solve_ivp(rate, (0.0, duration), x, "DOP853", rtol=1e-11, atol=1e-16).y[:, -1]

        return respond((A, B[:, :-1], C[:2], D[:2, :-1]), self.digital, nonlinear_loop.DT, u, propagate)


@pytest.mark.parametrize("delay", [{"delay": 0.0}, {"delay": 1.3, "steps": 2}], ids=["at once", "delayed"])
def test_disturbances_of_a_nonlinear_loop(delay):
    loop, rng = Levitated(**delay), np.random.default_rng(6)
    u = rng.choice([-1.0, 1.0], (20, 3)) * [1.0, 150.0, 3e-6]
    y, slopes = loop.core().sensitivity(loop.theta, list(range(len(loop.theta))), u)
    assert_close(y, loop.reference(loop.theta, u), 1e-7)
    for j, value in enumerate(loop.theta):
        h, at = 1e-3 * value, {}
        for n in (-2, -1, 1, 2):
            moved = loop.theta.copy()
            moved[j] += n * h
            at[n] = loop.reference(moved, u)
        assert_close(slopes[:, :, j], (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * h), 3e-6)
    assert_close(_core.Stepper(loop.core(), loop.theta).run(u), y, 1e-9)
