"""Long signals for a screen: of every pixel's samples the smallest and the largest, so that no peak is lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray

__all__ = ["thinned"]


def thinned(signals: FloatArray, pixels: int) -> NDArray[np.intp]:
    """Which samples to draw: those where a signal is smallest or largest within a pixel, and both ends.

    Parameters
    ----------
    signals : ndarray, shape (N, k)
        Drawn over the same samples; NaN where there is nothing.
    pixels : int
        Width of the chart.

    Returns
    -------
    ndarray of int
        In order; all samples where no more than two a pixel and signal are there.
    """
    count, k = signals.shape
    if count <= 2 * k * pixels:
        return np.arange(count)
    width = -(-count // pixels)
    padded = np.full((-(-count // width) * width, k), np.nan)
    padded[:count] = signals
    blocks = padded.reshape(-1, width, k)
    first = width * np.arange(len(blocks))[:, None]
    low = first + np.argmin(np.where(np.isnan(blocks), np.inf, blocks), axis=1)
    high = first + np.argmax(np.where(np.isnan(blocks), -np.inf, blocks), axis=1)
    kept = np.unique(np.concatenate([low.ravel(), high.ravel(), [0, count - 1]]))
    return np.asarray(kept[kept < count], dtype=np.intp)
