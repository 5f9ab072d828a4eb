"""Exact peaks of the sensitivity over frequency: what margins are made of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.robustness.sensitivity import BrokenLoop

NEAR = 0.7
"""Part of the largest value on the grid from which on another maximum may be the largest between its points."""
ROUNDS, POINTS = 7, 8
"""Of the search around a maximum, which each round makes narrower by (POINTS + 1) / 2: to 1e-9 of the peak's value,
as it is flat there."""


@dataclass(frozen=True)
class Peaks:
    """The peaks of all gains of a loop, see `gains`.

    Attributes
    ----------
    values : ndarray, shape (2 axes + 2,)
    frequency_hz : ndarray, shape (2 axes + 2,)
    """

    values: FloatArray
    frequency_hz: FloatArray


def gains(S: ComplexArray) -> FloatArray:
    """``|S_jj|`` and |S_jj - 1/2| of every axis j, and the largest singular values of S and of S - I/2.

    Parameters
    ----------
    S : ndarray, shape (F, axes, axes)

    Returns
    -------
    ndarray, shape (F, 2 axes + 2)
    """
    own = np.einsum("ljj->lj", S)
    half = S - 0.5 * np.eye(S.shape[1])
    squared = [np.linalg.eigvalsh(each.conj().swapaxes(1, 2) @ each)[:, -1] for each in (S, half)]
    whole = [np.sqrt(np.maximum(each, 0.0)) for each in squared]
    return np.column_stack([np.abs(own), np.abs(own - 0.5), *whole])


def find_peaks(
    sensitivity: Callable[[FloatArray], ComplexArray], grid_hz: FloatArray, values: FloatArray, rounds: int = ROUNDS
) -> Peaks:
    """The largest value of every gain, between the points of a grid too.

    Parameters
    ----------
    sensitivity : callable
        S at frequencies [Hz].
    grid_hz : ndarray, shape (F,)
    values : ndarray, shape (F, gains)
        On the grid.
    rounds : int
        Each makes the frequencies of the peaks 4.5 times as exact.
    """
    best, at = values.max(axis=0), grid_hz[values.argmax(axis=0)]
    found = [(k, gain) for gain in range(values.shape[1]) for k in _maxima(values[:, gain])]
    of = np.array([gain for _, gain in found])
    centre = np.array([k for k, _ in found])
    low, high = grid_hz[np.maximum(centre - 1, 0)], grid_hz[np.minimum(centre + 1, len(grid_hz) - 1)]
    rows = np.arange(len(of))
    for _ in range(rounds):
        f = np.linspace(low, high, POINTS + 2)[1:-1]
        own = gains(sensitivity(f.ravel())).reshape(*f.shape, -1)[:, rows, of]
        k = own.argmax(axis=0)
        wide = (high - low) / (POINTS + 1)
        top, where = own[k, rows], f[k, rows]
        low, high = np.maximum(low, where - wide), np.minimum(high, where + wide)
        for gain, value, frequency in zip(of, top, where, strict=True):
            if value > best[gain]:
                best[gain], at[gain] = value, frequency
    return Peaks(best, at)


def peaks_of(loop: BrokenLoop, theta: FloatArray) -> Peaks:
    """The peaks of a loop at parameter values."""
    grid = loop.grid(theta)
    return find_peaks(lambda f: loop.sensitivity(theta, f), grid, gains(loop.sensitivity(theta, grid)))


def slopes_of(loop: BrokenLoop, theta: FloatArray, peaks: Peaks, free: Sequence[int]) -> FloatArray:
    """Derivative of the peaks' values by the parameters in `free`, shape (2 axes + 2, len(free)).

    That of a maximum over frequency is the one at its frequency, and that of a gain ``Re(l* dS r)``, with the singular
    vectors l and r.
    """
    n = loop.axes
    S = loop.sensitivity(theta, peaks.frequency_hz)
    left, right = np.zeros((2 * n + 2, n), dtype=np.complex128), np.zeros((2 * n + 2, n), dtype=np.complex128)
    for j in range(n):
        for gain, entry in ((j, S[j, j, j]), (n + j, S[n + j, j, j] - 0.5)):
            left[gain, j], right[gain, j] = entry / abs(entry), 1.0
    for gain, matrix in ((2 * n, S[2 * n]), (2 * n + 1, S[2 * n + 1] - 0.5 * np.eye(n))):
        u, _, vh = np.linalg.svd(matrix)
        left[gain], right[gain] = u[:, 0], vh[0].conj()
    moved = loop.slopes(theta, peaks.frequency_hz, right, free)
    return np.einsum("qa,qap->qp", left.conj(), moved).real


def _maxima(values: FloatArray) -> list[int]:
    """Indices of the maxima of one gain that may be its peak, the ends of the grid among them."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    highest = np.flatnonzero((values >= padded[:-2]) & (values >= padded[2:]) & (values >= NEAR * values.max()))
    # maxima of one gain that are sought between the points of the grid, the largest ones
    return [int(k) for k in highest[np.argsort(-values[highest])][:4]]
