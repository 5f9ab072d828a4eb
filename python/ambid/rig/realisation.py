"""State space of what a rig file gives as gains or polynomials."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, matrix_balance

StateSpace = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def stack(systems: list[StateSpace], signals: int = 1) -> StateSpace:
    """Independent systems side by side, their columns signal by signal."""
    a, b, c, d = (block_diag(*blocks).astype(float) for blocks in zip(*systems, strict=True))
    columns = np.arange(d.shape[1]).reshape(len(systems), signals, -1).transpose(1, 0, 2).ravel()
    return a, b[:, columns], c, d[:, columns]


def added(systems: list[StateSpace]) -> StateSpace:
    """One system that adds the outputs of several, each with an input of its own."""
    a, b, *_ = stack(systems)
    return a, b, np.hstack([c for _, _, c, _ in systems]), np.hstack([d for *_, d in systems])


def pid(
    proportional: float, integral: float, derivative: float, time_constant: float, factors: Sequence[float]
) -> StateSpace:
    """P + I/s + D s/(T s + 1), the last as D/T - (D/T)/(T s + 1); each gain by a factor, which leaves the states."""
    of_p, of_i, of_d = factors
    poles, inputs, outputs, feedthrough = [], [], [], of_p * proportional
    if integral:
        poles, inputs, outputs = [0.0], [1.0], [of_i * integral]
    if derivative:
        poles.append(-1.0 / time_constant)
        inputs.append(1.0 / time_constant)
        outputs.append(-of_d * derivative / time_constant)
        feedthrough += of_d * derivative / time_constant
    a = np.diag(poles) if poles else np.zeros((0, 0))
    return a, np.reshape(inputs, (-1, 1)), np.reshape(outputs, (1, -1)), np.array([[feedthrough]])


def tustin(system: StateSpace, period: float) -> StateSpace:
    """Replace s by (2/h) (z - 1)/(z + 1), with h = `period` [s]."""
    a, b, c, d = system
    half = 0.5 * period * a
    inverse = np.linalg.inv(np.eye(len(a)) - half)
    b_discrete = period * inverse @ b
    return inverse @ (np.eye(len(a)) + half), b_discrete, c @ inverse, d + 0.5 * c @ b_discrete


def companion(numerator: NDArray[np.float64], denominator: NDArray[np.float64]) -> StateSpace:
    """Controllable form, its states scaled by powers of two so that A is balanced."""
    if len(denominator) == 1 or len(numerator) == 0:
        gain = numerator[0] / denominator[0] if len(numerator) else 0.0
        return np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[gain]])
    from scipy.signal import tf2ss  # slow to import, and seldom needed

    a, b, c, d = tf2ss(numerator, denominator)
    balanced, (scale, _) = matrix_balance(a, permute=False, separate=True)
    return balanced, b / scale[:, None], c * scale, d
