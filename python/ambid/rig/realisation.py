"""Linear systems of a rig file: whether their matrices fit, their state space, and objects of other packages."""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic_core import InitErrorDetails
from scipy.linalg import block_diag, matrix_balance

from ambid.arrays import StateSpace
from ambid.errors import RigError
from ambid.rig.fields import FINITE, problem


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


Matrix = tuple[tuple[Annotated[float, FINITE], ...], ...]


def wrong_counts(given: dict[str, tuple[Any, ...]], n_axes: int, signals: int = 1) -> list[InitErrorDetails]:
    """Problems of the keys that have neither one entry, nor one per signal, nor one per signal and axis."""
    per = "one per axis" if signals == 1 else f"{signals}, one per signal, or one per signal and axis"
    return [
        problem(f"expected 1 entry for all axes, or {n_axes * signals}, {per}; found {len(value)}.", value, key)
        for key, value in given.items()
        if len(value) not in (1, signals, n_axes * signals)
    ]


def sizes(a: Matrix, b: Matrix, c: Matrix, d: Matrix, signals: int) -> tuple[int, int]:
    """States and axes that most of four matrices agree on: one that is wrong does not make others wrong."""
    rows, columns = len(b), _width(c)
    states = rows if rows and rows == columns else len(a)
    axes = len(c) if c and _width(b) == len(c) * signals else len(d)
    return states, axes


def _width(rows: Matrix) -> int | None:
    """Numbers in each row; None where they are not as many."""
    widths = {len(row) for row in rows}
    return widths.pop() if len(widths) == 1 else None


def has_shape(rows: Matrix, shape: tuple[int, int]) -> bool:
    """Whether a matrix has so many rows of so many numbers; without rows or numbers it may be left out."""
    empty = 0 in shape and not any(rows)
    return empty or (len(rows) == shape[0] and all(len(row) == shape[1] for row in rows))


def as_state_space(system: Any) -> Any:
    """What the object itself makes of it; RigError where that is no state space, as of a frequency response."""
    try:
        return system.to_ss()
    except Exception as error:  # of another package: it may be any
        is_response = hasattr(system, "omega") or "frequency" in type(system).__name__.lower()
        what = (
            "a frequency response is no model of a controller, whose states are needed" if is_response else str(error)
        )
        raise RigError(
            f"controller: {type(system).__name__} object: {what}; expected a linear system with A, B, C, D or num, "
            "den: give the law itself, or fit one to the response first."
        ) from None


def per_axis_polynomials(rows: Any, may_couple: bool) -> list[list[float]]:
    """Polynomial of each axis, from SciPy's single one or python-control's outputs x inputs of them."""
    if np.isscalar(rows[0]):
        return [list(map(float, rows))]
    if np.isscalar(rows[0][0]):  # SciPy with one input, a row per output
        rows = [[row] for row in rows]
    coupled = not may_couple and any(np.any(p) for i, row in enumerate(rows) for j, p in enumerate(row) if i != j)
    if len(rows) != len(rows[0]) or coupled:
        raise RigError(
            f"controller: {len(rows)} x {len(rows[0])} transfer functions: expected a diagonal matrix, one per axis; "
            "convert coupled ones to state space first (control.ss)."
        )
    return [list(map(float, rows[k][k])) for k in range(len(rows))]
