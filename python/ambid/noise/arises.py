"""What a record says about where its noise arises."""

from __future__ import annotations

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.findings import Finding, Kind, Where
from ambid.noise.shape import Split

__all__ = ["NOISE_ARISES", "noise_arises"]

NOISE_ARISES = Kind(
    "noise_arises",
    "note",
    "noise of y: {heard_m:.2g|nm} heard by the controller, {recorder_m:.2g|nm} of the recorder"
    "[; noise of i_c: {heard_a:.2g|mA} heard by the controller, {recorder_a:.2g|mA} of the recorder]",
)
"""Rms as recorded, what is heard once round the loop; the mean power of all axes. That of i_c where the controller reads
it."""


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
    heard, recorder = split.shown(points)

    def rms(power: FloatArray) -> float:
        return float(np.sqrt(np.mean(power)))

    values = {"heard_m": rms(heard[:, :axes]), "recorder_m": rms(recorder[:, :axes])}
    if split.noise.heard > axes:
        values |= {"heard_a": rms(heard[:, axes:]), "recorder_a": rms(recorder[:, axes:])}
    return NOISE_ARISES(Where(record=record), **values)
