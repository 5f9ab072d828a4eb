"""Single samples of y and i_c that stand apart from the same samples of the other periods: spikes of a card or cable.

What differs from the median over the periods is held against the line between its neighbours, so that drift, hum and a
transient that dies away are none. A sample that stands out by far, alone, was not the machine's: its loop would have
answered.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.record.repeats import OUTLIER

__all__ = ["without_spikes"]

SURROUNDINGS = 100
"""Samples by which the deviation around a sample is judged. At a beginning at rest they are spared."""
MOST = 20
"""Spikes of a channel at most; more of them are no single samples."""


def without_spikes(x: FloatArray, period: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """A channel with what the other periods and its neighbours say in place of single samples that stand apart.

    Parameters
    ----------
    x : ndarray, shape (N,)
        At least three whole periods.
    period : int
        In samples.

    Returns
    -------
    cleaned : ndarray, shape (N,)
    rows : ndarray of int
        Of the samples that were replaced; none where they are more than `MOST`, beside each other, or a period apart.
    """
    rows: list[int] = []
    while (row := _worst(_apart(x, period, rows), rows)) is not None:
        if len(rows) == MOST or row % period in {known % period for known in rows}:
            return x, np.zeros(0, dtype=np.intp)
        rows.append(row)
    found = np.unique(rows).astype(np.intp)
    if not len(found) or (len(found) > 1 and np.diff(found).min() < 3):
        return x, found[:0]
    apart, cleaned = _apart(x, period, rows), x.copy()
    cleaned[found] -= apart[found] - 0.5 * (apart[found - 1] + apart[found + 1])
    return cleaned, found


def _worst(apart: FloatArray, known: list[int]) -> int | None:
    """The row that stands out most from the line between its neighbours, if one does beside those known."""
    off = np.abs(apart[1:-1] - 0.5 * (apart[:-2] + apart[2:]))
    blocks = len(off) // SURROUNDINGS
    if blocks < 3:
        return None
    around = np.median(off[: blocks * SURROUNDINGS].reshape(blocks, -1), axis=1)
    around = np.maximum(np.maximum(around, np.roll(around, 1)), np.roll(around, -1))
    around = np.maximum(around, np.median(around)) / 0.6745
    rounding = np.finfo(float).eps * float(np.ptp(apart))
    block = np.minimum(np.arange(len(off)) // SURROUNDINGS, blocks - 1)
    ratio = off / np.maximum(around, rounding)[block]
    ratio[:SURROUNDINGS] = 0.0
    for row in known:
        ratio[row - 2 : row + 1] = 0.0
    row = int(np.argmax(ratio))
    return row + 1 if ratio[row] > OUTLIER else None


def _apart(x: FloatArray, period: int, without: list[int]) -> FloatArray:
    """What differs from the median over all whole periods, those rows aside."""
    whole = len(x) // period * period
    usual = np.median(x[:whole].reshape(-1, period), axis=0)
    for row in without:
        others = np.arange(row % period, whole, period)
        usual[row % period] = np.median(x[others[~np.isin(others, without)]])
    return x - np.resize(usual, len(x))
