"""A mass that a magnet levitates, with dry friction: integrated by SciPy, no line of it shared with the product."""

import numpy as np
from scipy.integrate import odeint

from ambid.record import Record
from ambid.rig import Rig

K_I, K_S, TAU_E = 185.0, 1.18e6, 2.85e-4
FRICTION, KNEE = 3.0, 1e-3
"""Force [N], and the velocity [m/s] within which it changes its sign."""


def record(rig: Rig, i_e: np.ndarray, seed: int, *, sensor_noise: float = 3e-7, current_noise: float = 5e-3) -> Record:
    """A record of the machine, settled for a period before it; the noise of y goes round the loop.

    Parameters
    ----------
    rig : Rig
        Of one axis with an analog PID.
    i_e : ndarray, shape (N, 1)
        Whole periods of an excitation [A].
    """
    pid, lag, mass = rig.controller, rig.amplifier.time_constant, rig.rotor.mass
    p, i, d = (float(np.atleast_1d(gain)[0]) for gain in (pid.proportional, pid.integral, pid.derivative))
    late = pid.derivative_time_constant

    def rates(x, _, command, noise):
        s, v, i_c, i_f, total, slow = x
        y = s + noise
        i_ref = command - p * y - i * total - d * (y - slow) / late
        force = K_I * i_f + K_S * s - FRICTION * np.tanh(v / KNEE)
        return v, force / mass, (i_ref - i_c) / lag, (i_c - i_f) / TAU_E, y, (y - slow) / late

    random = np.random.default_rng(seed)
    warm = len(i_e) // 4
    commands = np.concatenate([i_e[-warm:, 0], i_e[:, 0]])
    read = sensor_noise * random.standard_normal(len(commands))
    state, signals = np.zeros(6), np.zeros((len(commands), 2))
    for k, (command, noise) in enumerate(zip(commands, read, strict=True)):
        signals[k] = state[0] + noise, state[2]
        state = odeint(rates, state, (0.0, 1.0 / rig.sample_rate), args=(command, noise), rtol=1e-8, atol=1e-12)[1]
    signals[:, 1] += current_noise * random.standard_normal(len(commands))
    y, i_c = signals[warm:, :1], signals[warm:, 1:]
    return Record.from_arrays(y=y, i_c=i_c, i_e=i_e, sample_rate=rig.sample_rate, axes=rig.axes, rig=rig)
