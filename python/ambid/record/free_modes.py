"""What the states of a controller held when a record began: its free response, separated from an excitation."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.record.repeats import find_period

REBUILT_TOLERANCE = 0.6
"""A rebuilt i_e carries the noise of its sources: two of its periods agree less well than those of a logged one."""
HOLDS = 0.5
"""Part of the samples at which an excitation of steps, or none, holds: more than half make a least sum exact."""


def free_modes(A: FloatArray, C: FloatArray, samples: int) -> list[FloatArray]:
    """C A^k for k = 0, 1, ..., of each output (samples, states): what a unit in each of its states leaves there.

    States that never reach an output are none of its own. A pole outside of the unit circle leaves what no sum of
    numbers holds: no state is returned then.
    """
    if np.abs(np.linalg.eigvals(A)).max(initial=0.0) > 1.0 + 1e-6:
        return [np.zeros((samples, 0))] * len(C)
    acts = (A != 0.0) | np.eye(len(A), dtype=bool)
    found = []
    for row in C:
        own = row != 0.0
        for _ in range(len(A)):
            own = own @ acts
        power = A[np.ix_(own, own)]
        modes = np.empty((samples, int(own.sum())))
        modes[:1], known = row[own], 1
        while known < samples:
            more = min(known, samples - known)
            modes[known : known + more] = modes[:more] @ power
            known, power = known + more, power @ power
        found.append(modes)
    return found


def is_held(left: FloatArray, rounding: FloatArray) -> NDArray[np.bool_]:
    """Samples (N, axes) at which what the law leaves changes by no more than rounding."""
    return np.asarray(np.abs(np.diff(left, axis=0, prepend=left[:1])) <= rounding)


def without_free_modes(
    left: FloatArray, modes: Sequence[FloatArray], rounding: FloatArray, period: int | None
) -> FloatArray:
    """What the law from rest leaves of a command, less the free response of the controller's states.

    Where an excitation holds from sample to sample, as steps do, or there is none, the least sum of the absolute values
    of its changes gives the states exactly, whatever else acts here and there. Else they are those by which it repeats
    best; without a period, those that leave least. What is then taken of a true excitation acts as other states at the
    first sample do: a response that the loop forgets, and that is fitted with every record.

    Parameters
    ----------
    left : ndarray, shape (N, axes)
        Up to the free response [A or V].
    modes : sequence of ndarray, shape (N, states)
        Of `free_modes`.
    rounding : ndarray, shape (axes,)
        Up to which a change is none.
    period : int, optional
        Samples per period, if it was stated.
    """
    by_changes = np.stack([_least_changes(own, modes[k], rounding[k]) for k, own in enumerate(left.T)], axis=1)
    if is_held(by_changes, rounding).mean() > HOLDS:
        return by_changes
    least = _each(left, modes, 0)
    period = period or find_period(least, tolerance=REBUILT_TOLERANCE)
    return least if period is None else _each(least, modes, period)


def _each(left: FloatArray, modes: Sequence[FloatArray], period: int) -> FloatArray:
    """Less the modes that leave least of each axis, or of its change over a period."""
    fitted = []
    for k, own in enumerate(left.T):
        mode = modes[k]
        goal, table = (own[period:] - own[:-period], mode[period:] - mode[:-period]) if period else (own, mode)
        basis, back = _basis(table)
        fitted.append(own - mode @ (back @ (basis.T @ goal)))
    return np.stack(fitted, axis=1)


def _least_changes(own: FloatArray, mode: FloatArray, rounding: float) -> FloatArray:
    """Less the modes by which the sum of absolute changes of one axis is least."""
    goal = np.diff(own)
    basis, back = _basis(np.diff(mode, axis=0))
    if not basis.size:
        return own
    x = basis.T @ goal
    floor = np.abs(goal - basis @ x).max()
    for _ in range(20):  # for the least sum of absolute values; each about halves what is left of the way
        change = goal - basis @ x
        weighted = basis / np.hypot(change, max(floor, 1e-3 * rounding, 1e-300))[:, None]
        x = _solved(weighted.T @ basis, weighted.T @ goal)
        floor *= 0.3
    kept = np.abs(goal - basis @ x) <= rounding
    if kept.mean() > HOLDS:
        x = _solved(basis[kept], goal[kept])
    return np.asarray(own - mode @ (back @ x))


def _solved(table: FloatArray, goal: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(table, goal, rcond=None)[0], dtype=np.float64)


def _basis(table: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns that span a table, and the factors of its own columns that they stand for."""
    size = np.linalg.norm(table, axis=0)
    table = table[:, size > 0.0] / size[size > 0.0]
    u, s, vt = np.linalg.svd(table, full_matrices=False)
    kept = s > 1e-12 * s.max(initial=0.0)  # part of the largest singular value below which free modes are the same
    back = np.zeros((len(size), int(kept.sum())))
    back[size > 0.0] = vt[kept].T / s[kept] / size[size > 0.0][:, None]
    return u[:, kept], back
