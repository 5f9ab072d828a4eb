"""What a record says about where its noise arises."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambid.arrays import ComplexArray
from ambid.findings import Finding, Kind, Where
from ambid.noise.shape import Split

__all__ = ["NOISE_ARISES", "noise_arises"]

NOISE_ARISES = Kind(
    "noise_arises",
    "note",
    "noise of y: {heard_m:.3g|nm} heard by the controller, {recorder_m:.3g|nm} of the recorder"
    "[, {either_m:.3g|nm} of either][; noise of i_c: {heard_a:.3g|mA} heard, {recorder_a:.3g|mA} of the recorder]"
    "[, {either_a:.3g|mA} of either]",
)
"""Rms as recorded, what is heard once round the loop, in the mean over all axes. What may be either is of frequencies
at which the loop leaves noise as it is. That of i_c where the controller reads it."""
LEAST = 0.1
"""Part of the power that may be either, to be told of."""


def noise_arises(split: Split, points: ComplexArray, axes: int, record: str) -> Finding:
    """What noise is heard by the controller and what is not, by its mean over lines that are spread evenly.

    Parameters
    ----------
    split : Split
    points : ndarray of complex
        Of the lines, on the unit circle.
    axes : int
    record : str
        Its name.
    """
    values: dict[str, Any] = {}
    for unit, own in (("m", slice(0, axes)), ("a", slice(axes, None))):
        powers = [float(np.mean(power[:, own])) for power in split.shown(points) if power[:, own].size]
        if powers:
            heard, recorder, either = np.sqrt(powers).tolist()
            is_clear = either**2 > LEAST * sum(powers)
            values |= {f"heard_{unit}": heard, f"recorder_{unit}": recorder}
            values[f"either_{unit}"] = either if is_clear else None
    return NOISE_ARISES(Where(record=record), **values)
