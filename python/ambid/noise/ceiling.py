"""The fit that noise allows: what a record repeats from period to period, and what it does not."""

import numpy as np

from ambid.arrays import FloatArray
from ambid.record import Record

UNSETTLED = 1.1
"""Scatter of a period too many over that of the later ones; it holds a transient then."""


def noise_ceiling(record: Record) -> dict[str, float]:
    """Fit [%] that the exact model would reach, from the scatter of y and i_c over the periods.

    The first period holds the transient and is left out, and further ones while that makes the scatter less by more
    than a tenth, as long as two remain. Over the M that remain, with xbar their mean period,

        ceiling = 100 (1 - sqrt(M / (M - 1)) ||x - xbar|| / ||x - mean x||),

    where the factor undoes that xbar was fitted to the same noise.

    Parameters
    ----------
    record : Record
        With a period.

    Returns
    -------
    dict of str to float
        By channel, such as ``y.A_zeta``; NaN where fewer than 2 periods remain (the record's notes say so).
    """
    kept = record.periods - 1
    ceiling = {}
    for channel, values in zip(record.channels, (x for part in record.parts for x in part.T), strict=True):
        if record.period is None or kept < 2:
            ceiling[channel] = float("nan")
            continue
        x = values[record.period : (kept + 1) * record.period].reshape(kept, record.period)
        missed = [_scatter(x[first:]) for first in range(kept - 1)]
        settled = next((m for first, m in enumerate(missed) if m <= UNSETTLED * min(missed[first:])), np.nan)
        ceiling[channel] = float(100 * (1 - settled))
    return ceiling


def _scatter(x: FloatArray) -> float:
    """Of periods (M, N) about their mean, relative to what they hold; free from bias by the mean."""
    return float(np.linalg.norm(x - x.mean(axis=0)) * np.sqrt(len(x) / (len(x) - 1)) / np.linalg.norm(x - x.mean()))
