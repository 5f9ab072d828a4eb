"""Numbers of laws of integrator.c, and of the half-order lag."""

from functools import cache

import numpy as np

from .network import library

IRON = {"linear": 0, "tanh": 1, "blend": 2}


def magnet(K_i: float, K_s: float, bias_current: float, level: float = 0.0, curve: str = "linear") -> list[float]:
    """Numbers of the port law "magnet", whose slopes at rest are K_i and K_s.

    f = scale (beta_+^2 - beta_-^2), beta the flux density that the iron allows for the linear one,
    (i0 +- i) / (gap -+ s) gap / i0, which is 1 at rest. Both slopes share beta beta', so that gap = i0 K_i / K_s.
    """
    kind = IRON[curve if level else "linear"]
    level = level or 1.0
    step = 1e-4 * level
    value = library().iron(kind, level) / level
    slope = (library().iron(kind, level + step) - library().iron(kind, level - step)) / (2.0 * step)
    scale = K_i * bias_current / (4.0 * value * slope)
    return [bias_current, bias_current * K_i / K_s, scale, K_i, K_s, kind, level]


@cache
def half_order(tau: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Poles p [rad/s], weights w and constant c of ``1/(1 + sqrt(tau s)) ~ c + sum w p / (s + p)``.

    The error from 0.1 Hz to 20 kHz is below 1e-4; the value at rest is 1.
    """
    poles = 2.0 * np.pi * np.geomspace(0.01, 5e5, 20)
    s = 2j * np.pi * np.geomspace(0.05, 3e4, 600)
    basis = poles / (s[:, None] + poles) - 1.0  # 1 + sum w (p / (s + p) - 1)
    wanted = 1.0 / (1.0 + np.sqrt(tau * s)) - 1.0
    both = np.concatenate([basis.real, basis.imag]), np.concatenate([wanted.real, wanted.imag])
    weights = np.linalg.lstsq(*both, rcond=1e-10)[0]
    return poles, weights, 1.0 - float(weights.sum())
