"""Long signals for a screen: of every pixel's samples the smallest and the largest, so that no peak is lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray

__all__ = ["in_a_row", "thinned"]


def thinned(signals: FloatArray, pixel: NDArray[np.intp]) -> NDArray[np.intp]:
    """Which samples to draw: those where a signal is smallest or largest within a pixel, and both ends.

    Parameters
    ----------
    signals : ndarray, shape (N, k)
        Drawn over the same samples; NaN where there is nothing.
    pixel : ndarray of int, shape (N,)
        Which pixel each sample falls in, rising.

    Returns
    -------
    ndarray of int
        In order; of a pixel with many equal extremes the first.
    """
    first = np.flatnonzero(np.diff(pixel, prepend=pixel[0] - 1))
    own = np.repeat(np.arange(len(first)), np.diff(first, append=len(pixel)))
    kept = [np.array([0, len(pixel) - 1])]
    for signal in signals.T:
        for least in (signal, -signal):
            reached = np.fmin.reduceat(least, first)[own] == least
            at = np.flatnonzero(reached)
            kept.append(at[np.unique(own[at], return_index=True)[1]])
    return np.asarray(np.unique(np.concatenate(kept)), dtype=np.intp)


def in_a_row(count: int, pixels: int) -> NDArray[np.intp]:
    """The pixels of so many samples, evenly spread over a chart."""
    return np.asarray(np.arange(count) * pixels // count, dtype=np.intp)
