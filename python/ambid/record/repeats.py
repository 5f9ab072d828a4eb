"""The period of an excitation, and where a logged one of several periods does not repeat.

There the period is found from the parts that repeat. A sample that differs from those a period before and after it,
which agree, is wrong; where all that follows comes earlier or later by whole samples, rows were lost or repeated.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.arrays import FloatArray

CLEAN_SHARE = 0.3
"""Part of the stretches that must repeat: one loss spoils a period, which is half of what can be compared in three."""
ALIKE = 0.3
"""Relative rms mismatch up to which stretches repeat: 20 % of noise on i_e. What never repeats has 1.4."""
OUTLIER = 8.0
"""Robust standard deviations of the noise of i_e beyond which a sample does not repeat; chance has none in 1e14."""
ROUNDING = 1e-6
"""Part of the rms of i_e that counts as rounding of a logged one."""
MOST_LOST = 50
"""Rows that are lost or repeated at one place, at most."""
MOST_WRONG = 20
"""Wrong samples that are taken for single ones, at most; more are another excitation, and no spikes of a channel."""
A_STEP = 2 * MOST_LOST
"""Samples by which a period may be longer that needs a step less: all periods but one are then still compared."""
CERTAIN = 20.0
"""Bits that a period must save: a random excitation has one by chance once in a million records."""
SPOILT = 0.4
"""Part of the share of samples that differ from the next one, at which a stretch does not repeat: rows were lost."""


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


@dataclass(frozen=True)
class Step:
    """Rows lost, or repeated if negative, at a row counted from 0; the place is known to a hold of the excitation."""

    row: int
    lost: int


@dataclass(frozen=True)
class Repeats:
    """How an excitation repeats.

    Attributes
    ----------
    period : int
        In samples.
    wrong : ndarray of int, shape (k, 2)
        Row and axis of single wrong samples.
    steps : tuple of Step
    """

    period: int
    wrong: NDArray[np.intp]
    steps: tuple[Step, ...]


def repeats(i_e: FloatArray) -> Repeats | None:
    """How an excitation repeats that does not do so throughout; None where no period explains most of it.

    Parameters
    ----------
    i_e : ndarray, shape (N, axes)
    """
    x = np.asarray(i_e, dtype=np.float64)
    low, high = np.quantile(x, [0.005, 0.995], axis=0)
    kept = high > low
    x = np.clip(x, low, high)[:, kept]
    if x.shape[1] == 0:
        return None
    x = (x - x.mean(axis=0)) / x.std(axis=0)
    tried = []
    for period in _candidates(x):
        steps = _steps(x, period)
        if steps is not None and (wrong := _wrong(np.asarray(i_e), period, steps)) is not None:
            own = Repeats(period, wrong, steps)
            if _is_shorter(x, own):
                tried.append(own)
    return min(tried, key=lambda own: own.period + A_STEP * len(own.steps) + len(own.wrong), default=None)


def _is_shorter(x: FloatArray, own: Repeats) -> bool:
    """Whether saying how it repeats takes fewer bits than saying what repeats; random ones do so once in 2^bits saved.

    What repeats is a choice of two values in as many rows as twice the changes, at the least, of a random binary
    sequence whatever its hold (no-hypercompression: Gruenwald, The Minimum Description Length Principle, 2007, 3.3).
    """
    samples, (wrong, steps) = len(x), (len(own.wrong), len(own.steps))
    alike = np.ones(samples - own.period, dtype=bool)
    for step in own.steps:
        alike[max(0, step.row - own.period - MOST_LOST) : step.row + MOST_LOST] = False
    per_row = min(1.0, 2.0 * float(np.mean(_apart(x, 1) > ROUNDING)))
    places = (1 + wrong + steps) * np.log2(samples) + wrong * np.log2(2 * x.shape[1]) + steps * np.log2(2 * MOST_LOST)
    return bool(per_row * np.sum(alike) > places + CERTAIN)


def _candidates(x: FloatArray) -> list[int]:
    """Lags at which enough stretches repeat as well as at any."""
    lags, mismatch = mismatches(x)
    unlike = np.flatnonzero(mismatch >= 1.0)
    if not unlike.size:
        return []
    inner = np.arange(unlike[0] + 1, len(lags) - 1)
    dips = inner[(mismatch[inner] <= mismatch[inner - 1]) & (mismatch[inner] <= mismatch[inner + 1])]
    dips = dips[mismatch[dips] < 1.15]  # over all of a record: worth a look at its stretches
    dips = dips[np.argsort(mismatch[dips])[:12]]
    found = [(int(lags[k]), _of_stretches(x, int(lags[k]))) for k in dips]
    best = min((own for _, own in found), default=np.inf)
    return [lag for lag, own in found if own <= min(ALIKE, 1.5 * best + 0.01)]


def _of_stretches(x: FloatArray, lag: int) -> float:
    """Relative rms mismatch that the better stretches have at a lag."""
    apart = np.mean((x[lag:] - x[:-lag]) ** 2, axis=1)
    return float(np.sqrt(np.quantile([part.mean() for part in _stretches(apart)], CLEAN_SHARE)))


def _stretches(apart: FloatArray) -> list[FloatArray]:
    return np.array_split(apart, min(40, len(apart)))


def _apart(x: FloatArray, lag: int) -> FloatArray:
    """Largest difference over the axes between samples and those of a lag later."""
    return np.asarray(np.abs(x[lag:] - x[:-lag]).max(axis=1))


def _steps(x: FloatArray, period: int) -> tuple[Step, ...] | None:
    """Where rows are lost or repeated; None where stretches that do not repeat have another cause."""
    found: list[Step] = []
    apart = _apart(x, period)
    noise = np.quantile([np.median(part) for part in _stretches(apart)], CLEAN_SHARE) / 0.6745
    tolerance = max(OUTLIER * noise, ROUNDING)
    differs = apart > tolerance
    least = SPOILT * float(np.mean(_apart(x, 1) > tolerance))
    length = max(16, period // 4)
    share = np.convolve(differs, np.ones(length) / length, mode="same")
    edges = np.flatnonzero(np.diff(np.concatenate([[False], share > least, [False]]).astype(int)))
    for first, end in edges.reshape(-1, 2):
        own = np.flatnonzero(differs[first:end]) + first
        inside = np.arange(own[0], own[-1] + 1) if len(own) else own
        if len(inside) < length // 2:
            continue  # a single wrong sample, or a few
        tried = [j for j in range(-MOST_LOST, MOST_LOST + 1) if j]
        shares = []
        for j in tried:
            at = inside[(inside + period - j < len(x)) & (inside + period - j >= 0)]
            near = np.abs(x[at + period - j] - x[at]).max(axis=1, initial=0.0) <= tolerance
            shares.append(1.0 - float(np.mean(near)) if len(at) else 1.0)
        best = int(np.argmin(shares))
        if shares[best] > least:
            return None
        # what is lost at a row changes what is compared with it from a period before on
        row = int(own[-1]) + 1 if end < len(differs) else int(own[0]) + period
        if found and found[-1].lost == tried[best] and row - found[-1].row < period:
            found.pop()  # the same, with a stretch between in which the excitation stands still
        found.append(Step(row, tried[best]))
    return tuple(found)


def _wrong(i_e: FloatArray, period: int, steps: tuple[Step, ...]) -> NDArray[np.intp] | None:
    """Rows and axes of single wrong samples; None if there are too many of them."""
    found = []
    for axis, x in enumerate(i_e.T):
        apart = x[period:] - x[:-period]
        noise = 1.4826 * float(np.median(np.abs(apart)))
        differs = np.abs(apart) > max(OUTLIER * noise, ROUNDING * float(x.std()))
        for step in steps:
            differs[max(0, step.row - period - MOST_LOST) : step.row + MOST_LOST] = False
        later = np.flatnonzero(differs)
        own = {int(k) for k in later} | {int(k) + period for k in later}
        own = {k for k in own if _is_odd(x, differs, k, period)}
        found += [(k, axis) for k in sorted(own)]
        if len(found) > MOST_WRONG:
            return None
    return np.array(found, dtype=np.intp).reshape(-1, 2)


def _is_odd(x: FloatArray, differs: NDArray[np.bool_], k: int, period: int) -> bool:
    """Whether it is this sample that differs from its neighbours in phase, and not one of them."""
    neighbours = [j for j in (k - period, k + period) if 0 <= j < len(x)]
    if not all(differs[min(j, k)] for j in neighbours):
        return False
    if len(neighbours) > 1:
        return True
    (other,) = neighbours
    further = 2 * other - k
    if 0 <= further < len(x):
        return not differs[min(other, further)]
    return _beside_itself(x, k) >= _beside_itself(x, other)  # only two have this phase


def _beside_itself(x: FloatArray, k: int) -> float:
    """By how much a sample is off the line between those before and after it."""
    return float(abs(x[k] - 0.5 * (x[max(k - 1, 0)] + x[min(k + 1, len(x) - 1)])))
