"""The period of an excitation, found from its samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.arrays import FloatArray

__all__ = ["find_period", "mismatches"]


def find_period(i_e: ArrayLike, *, tolerance: float = 1e-3) -> int | None:
    """Smallest number of samples after which the excitation of all axes repeats.

    The mismatch of a lag P is ||x[k + P] - x[k]|| / ||x||, the worst over the axes, computed for all lags at once from
    the autocorrelation. A logged excitation repeats exactly, a measured one up to its noise: the answer is the smallest
    lag as good as the best, and no worse than the tolerance.

    Parameters
    ----------
    i_e : array_like, shape (N,) or (N, axes)
        Excitation currents [A]. An axis whose rms is below 1e-3 of the largest counts as not excited.
    tolerance : float
        Largest relative rms mismatch between one period and the next.

    Returns
    -------
    int or None
        Period in samples, at most N // 2 (two whole periods); None if there is none.
    """
    x = np.asarray(i_e, dtype=np.float64)
    samples = len(x)
    x = x.reshape(samples, -1)
    if samples < 2 or not np.any(np.ptp(x, axis=0)):
        return None
    lags, mismatch = mismatches(x)
    # Without a mean, a signal is uncorrelated with itself somewhere in every period: the search starts there, past the
    # lags at which a slow signal merely resembles itself, and ends where it is lost again.
    unlike = np.flatnonzero(mismatch >= 1.0)
    if unlike.size == 0:
        return None
    # All multiples of the period are equally good up to the noise: four standard errors of a mismatch.
    best = mismatch[unlike[0] :].min()
    limit = min(tolerance, max((1 + 4 / np.sqrt(samples)) * best, 0.01 * tolerance))
    good = np.flatnonzero(mismatch <= limit)
    good = good[good > unlike[0]]
    if good.size == 0:
        return None
    end = unlike[np.searchsorted(unlike, good[0])] if unlike[-1] > good[0] else len(lags)
    return int(lags[good[0] + np.argmin(mismatch[good[0] : end])])


def mismatches(x: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Relative rms mismatch of a signal (N, axes) with itself at every lag up to N // 2, the worst of the axes.

    An axis whose rms is below 1e-3 of the largest does not count.
    """
    samples = len(x)
    x = x - x.mean(axis=0)
    x = np.ldexp(x, -np.frexp(np.abs(x).max())[1])  # exact, and no square of it leaves floating point
    rms = np.sqrt(np.mean(x**2, axis=0))
    x = x[:, rms > 1e-3 * rms.max()] / rms[rms > 1e-3 * rms.max()]
    lags = np.arange(1, samples // 2 + 1)
    spectrum = np.fft.rfft(x, n=2 * samples, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, n=2 * samples, axis=0)[lags]
    energy = np.cumsum(x**2, axis=0)
    overlap = energy[samples - 1 - lags] + energy[-1] - energy[lags - 1]
    return lags, np.sqrt(np.clip(2 - 4 * correlation / overlap, 0, None).max(axis=1))
