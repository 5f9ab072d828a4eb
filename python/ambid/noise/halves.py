"""Is the noise of a record without periods the same in both of its halves?

Periods show by themselves what does not repeat. Without them the noise is one spectrum for the whole record: what
changes on the way is taken for even noise, which it is not.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

from ambid.arrays import FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind, Where
from ambid.noise.adequacy import Criterion
from ambid.noise.chance import UNUSUAL
from ambid.noise.local import beside_excitation, driving, regression
from ambid.noise.window import Window, thinned
from ambid.record import Record

MATTERS = 1.25
"""Ratio r of both powers below which nothing is said: the variance of J grows by 2 (1 + r²) / (1 + r)², a hundredth."""
LEAST_SAMPLES = 500
"""Samples of a half that is judged."""
JUDGED = 4096
"""Lines of a half that are judged: they give the ratio to 5 %."""
BESIDE = 3
"""Lines to each side that even out the spectrum, so that no peak speaks for all lines."""
UNEVEN = Kind(
    "noise_not_stationary",
    "warning",
    "the noise has {ratio:.2g} times the power in the second half of the record, and misfit and intervals take it as "
    "stationary",
    "look for what changed during the record, and judge each half by itself, or record again",
)


def uneven(record: Record, residual: FloatArray, excitation: FloatArray) -> Finding | None:
    """Find in which channel the noise of a record without periods differs most between its halves.

    What of each half follows neither the excitation nor a transient is its noise. The ratio of the halves' mean powers,
    evened over frequency, is held against F with the degrees of freedom that the regressions leave.

    Parameters
    ----------
    record : Record
    residual : ndarray, shape (N, p)
        Measured minus simulated by a model that is adequate.
    excitation : ndarray, shape (N, axes)

    Returns
    -------
    Finding or None
        None where the ratio may be chance, or is too small to matter, or a half is too short.
    """
    samples = record.samples // 2
    if record.period is not None or samples < LEAST_SAMPLES:
        return None
    try:
        first, second = (_powers(residual, excitation, Window(samples, 1, begin)) for begin in (0, samples))
    except RecordError:
        return None  # too few lines for so many channels
    level = uniform_filter1d(first + second, 2 * BESIDE + 1, axis=0, mode="reflect")
    ratio = np.mean(second / level, axis=0) / np.mean(first / level, axis=0)
    k = int(np.argmax(np.abs(np.log(ratio))))
    fitted, width = regression(len(level), driving(excitation).shape[1])
    free = 2.0 * len(level) * (1.0 - fitted / width)
    larger, trials = max(ratio[k], 1.0 / ratio[k]), 2.0 * len(ratio)  # either half may be louder
    if not Criterion("halves", larger, free, free, trials, least=MATTERS, level=UNUSUAL).fails:
        return None
    return UNEVEN(Where(record=record.name, channel=record.channels[k]), ratio=float(ratio[k]))


def _powers(residual: FloatArray, excitation: FloatArray, half: Window) -> FloatArray:
    """Power of the noise on lines of a half, shape (lines, p)."""
    index = thinned(half.in_period, JUDGED)
    [found] = beside_excitation([half.lines(residual)[index]], half.lines(excitation)[index])
    return found.power
