"""A closed loop of magnetic bearings written from its physics, independent of the package's matrices and of its core.

Only the rotor's modes (frequencies, damping, shapes, gyroscopic matrix) are taken over from the package. Here their
planes are the global x and y; the package lays them along the axes of the first bearing.
"""

from collections import deque
from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np
from scipy.integrate import solve_ivp

from ambid.rig import PidController, Rig
from ambid.rotor import reduced_rotor

modes = cache(reduced_rotor)


def by_series(slope: Callable, x: np.ndarray, duration: float) -> np.ndarray:
    """Taylor series of x' = slope(x), slope affine: exact to rounding, and right for complex numbers too."""
    rest = slope(np.zeros_like(x))
    term = duration * slope(x)
    for k in range(2, 33):
        x = x + term
        term = duration / k * (slope(term) - rest)
    return x


def by_integration(slope: Callable, x: np.ndarray, duration: float) -> np.ndarray:
    """Explicit Runge-Kutta of order 8 with a fine tolerance; for one set of parameters."""
    steps = solve_ivp(
        lambda _, x: slope(x[:, None])[:, 0], (0.0, duration), x[:, 0], method="DOP853", rtol=1e-12, atol=1e-17
    )
    return steps.y[:, -1:]


class Pid:
    """P + I/s + D s/(T s + 1): by its frequency response, by its states, or in samples by the trapezoidal rule."""

    def __init__(self, spec: PidController) -> None:
        self.P, self.I, self.D = spec.proportional, spec.integral, spec.derivative
        self.T = spec.derivative_time_constant

    def response(self, s: complex) -> complex:
        return self.P + self.I / s + self.D * s / (self.T * s + 1.0)

    def output(self, y, integral, lagged):
        """Output in continuous time; the states follow ``integral' = y``, ``T lagged' = y - lagged``."""
        return self.P * y + self.I * integral + self.D * (y - lagged) / self.T

    def samples(self, step: float) -> Callable:
        """Function that takes y and returns the output, to be called once in every `step` seconds."""
        before = integral = derivative = 0.0

        def sample(y):
            nonlocal before, integral, derivative
            integral = integral + step / 2.0 * (y + before)
            derivative = ((2.0 * self.T - step) * derivative + 2.0 * self.D * (y - before)) / (2.0 * self.T + step)
            before = y
            return self.P * y + self.I * integral + derivative

        return sample


class PhysicalLoop:
    """Rotor, amplifiers, actuators and PID of one rig at one or more sets of parameters.

    Parameters
    ----------
    rig : Rig
        With a PID.
    K_i, K_s, tau_e : ndarray, shape (axes, sets)
        N/A, N/m and s; may be complex.
    """

    def __init__(self, rig: Rig, K_i: np.ndarray, K_s: np.ndarray, tau_e: np.ndarray) -> None:
        self.rig, self.K_i, self.K_s, self.tau_e = rig, K_i, K_s, tau_e
        self.pid = Pid(rig.controller)
        rotor = modes(rig.rotor, tuple(z for b in rig.bearings for z in (b.position, b.sensor_position)))
        magnet, sensor = [], []
        for bearing in rig.bearings:
            c, s = np.cos(np.deg2rad(bearing.tilt)), np.sin(np.deg2rad(bearing.tilt))
            for x, y in ([c, s], [-s, c])[: len(bearing.axes)]:
                for rows, z in ((magnet, bearing.position), (sensor, bearing.sensor_position)):
                    rows.append(np.concatenate([x * rotor.shape(z), y * rotor.shape(z)]))
        if rotor.planes == 1:  # tilt means nothing to a single axis
            magnet = sensor = [rotor.shape(0.0)]
        self.magnet, self.sensor = np.array(magnet), np.array(sensor)
        omega, zeta = (np.tile(values, rotor.planes) for values in (rotor.frequencies_rad_s, rotor.damping))
        self.stiffness, self.damping = np.diag(omega**2), np.diag(2.0 * zeta * omega) + rig.speed * rotor.gyroscopic
        n, m = self.magnet.shape
        ends = [0, m, 2 * m, *range(2 * m + n, 2 * m + 5 * n, n)]
        self.states = ends[-1]
        self.eta, self.rate, self.i_a, self.i_f, self.integral, self.lagged = map(slice, ends[:-1], ends[1:])

    # Time -------------------------------------------------------------------------------------------------------------

    def respond(self, u: np.ndarray, noise: np.ndarray | None = None, propagate: Callable = by_series) -> np.ndarray:
        """Displacements and currents from rest, shape (samples, 2 axes, sets), of an excitation (samples, axes)."""
        u = u[:, :, None]
        noise = np.zeros_like(u) if noise is None else noise[:, :, None]
        run = self._digital if self.rig.controller.is_digital else self._analog
        return np.array(list(run(u, noise, propagate)))

    def _rest(self) -> np.ndarray:
        return np.zeros((self.states, self.K_i.shape[1]), dtype=self.K_i.dtype)

    def _motion(self, x: np.ndarray, i_ref: np.ndarray) -> np.ndarray:
        """Slope of everything but the controller."""
        i_a, i_f = self._current(x, i_ref), x[self.i_f]
        force = self.K_i * i_f + self.K_s * (self.magnet @ x[self.eta])
        slope = np.zeros_like(x)
        slope[self.eta] = x[self.rate]
        slope[self.rate] = self.magnet.T @ force - self.stiffness @ x[self.eta] - self.damping @ x[self.rate]
        if self.rig.amplifier.time_constant > 0.0:
            slope[self.i_a] = (i_ref - i_a) / self.rig.amplifier.time_constant
        slope[self.i_f] = (i_a - i_f) / self.tau_e
        return slope

    def _current(self, x: np.ndarray, i_ref: np.ndarray) -> np.ndarray:
        return x[self.i_a] if self.rig.amplifier.time_constant > 0.0 else i_ref

    def _outputs(self, x: np.ndarray, i_ref: np.ndarray, noise: np.ndarray) -> np.ndarray:
        i_c = np.broadcast_to(self._current(x, i_ref), (len(self.magnet), x.shape[1]))
        return np.concatenate([self.sensor @ x[self.eta] + noise, i_c])

    def _analog(self, u: np.ndarray, noise: np.ndarray, propagate: Callable) -> Iterator[np.ndarray]:
        def command(x, i_e, n):
            return -self.pid.output(self.sensor @ x[self.eta] + n, x[self.integral], x[self.lagged]) + i_e

        def slope(x, i_e, n):
            slope = self._motion(x, command(x, i_e, n))
            slope[self.integral] = self.sensor @ x[self.eta] + n
            slope[self.lagged] = (self.sensor @ x[self.eta] + n - x[self.lagged]) / self.pid.T
            return slope

        x = self._rest()
        for i_e, n in zip(u, noise, strict=True):
            yield self._outputs(x, command(x, i_e, n), n)
            x = propagate(partial(slope, i_e=i_e, n=n), x, 1.0 / self.rig.sample_rate)

    def _digital(self, u: np.ndarray, noise: np.ndarray, propagate: Callable) -> Iterator[np.ndarray]:
        controller = self.rig.controller
        step = 1.0 / controller.rate(self.rig.sample_rate)
        whole, fraction = int(controller.delay_samples), controller.delay_samples % 1.0
        stretches = [(fraction * step, whole + 1), ((1.0 - fraction) * step, whole)][0 if fraction else 1 :]
        sample, x = self.pid.samples(step), self._rest()
        commands = deque([np.zeros_like(u[0])] * (whole + 2), maxlen=whole + 2)  # newest first
        for i_e, n in zip(u, noise, strict=True):
            for turn in range(round(1.0 / step / self.rig.sample_rate)):
                commands.appendleft(-sample(self.sensor @ x[self.eta] + n) + i_e)
                if turn == 0:
                    yield self._outputs(x, commands[stretches[0][1]], n)
                for duration, age in stretches:
                    x = propagate(partial(self._motion, i_ref=commands[age]), x, duration)

    # Frequency --------------------------------------------------------------------------------------------------------

    def sensitivity_function(self, omega: float) -> np.ndarray:
        """Transfer from sensor noise, held over each sample, to measured y at `omega` [rad/s]: (axes, axes)."""
        controller, dt = self.rig.controller, 1.0 / self.rig.sample_rate
        eye, z = np.eye(len(self.magnet)), np.exp(1j * omega * dt)
        if not controller.is_digital:
            fed_back = partial(self._fed_back, eye=eye)
            return eye + _held(fed_back, omega, dt)
        delayed = _held(lambda s: self._plant(s) * np.exp(-s * controller.delay_samples * dt), omega, dt)
        return np.linalg.inv(eye + delayed * self.pid.response(2.0 / dt * (z - 1.0) / (z + 1.0)))

    def _fed_back(self, s: complex, eye: np.ndarray) -> np.ndarray:
        """S - I of the analog loop."""
        return np.linalg.inv(eye + self._plant(s) * self.pid.response(s)) - eye

    def _plant(self, s: complex) -> np.ndarray:
        """Transfer from commands to displacements at the sensors."""
        free = s**2 * np.eye(len(self.stiffness)) + s * self.damping + self.stiffness
        held = free - self.magnet.T @ (self.K_s * self.magnet)
        force = self.K_i / (self.tau_e * s + 1.0) / (self.rig.amplifier.time_constant * s + 1.0)
        return self.sensor @ np.linalg.solve(held, self.magnet.T) * force.T


def _held(transfer: Callable, omega: float, dt: float) -> np.ndarray:
    """Sampled transfer behind a zero-order hold, as the sum over the aliases of `omega`; they fall off as k^-5."""
    aliases = 1j * (omega + 2.0 * np.pi / dt * np.arange(-60, 61))
    return sum(transfer(s) * (1.0 - np.exp(-s * dt)) / (s * dt) for s in aliases)
