"""Inputs at one frequency, and which of them turn with the rotor."""

from __future__ import annotations

from math import pi

import numpy as np

from ambid.arrays import FloatArray
from ambid.loop.effect import Tone
from ambid.record import Record
from ambid.rig import Rig

NEAR_SPEED = 0.02
"""Part by which a tone may lie off the speed of the rig file and still be called synchronous."""


def is_synchronous(tone: Tone, rig: Rig) -> bool:
    """Whether a tone turns with the rotor."""
    own = rig.speed / (2.0 * pi)
    return abs(tone.frequency_hz - own) < NEAR_SPEED * own


def cosine_and_sine(
    frequency: float, sample_rate: float, samples: int, record: Record | None, reference: int
) -> FloatArray:
    """Cosine and sine, shape (samples, 2), that count their angle from that of a record's displacement.

    The start of a record has no fixed angle to the rotor or to the mains; the displacement of one axis at that
    frequency has.
    """
    angle = 2.0 * pi * frequency / sample_rate * np.arange(samples)
    if record is not None:
        whole = slice(record.period or 0, samples)
        y = record.y[whole, reference]
        if record.period is not None:
            y = y - np.resize(y[: len(y) // record.period * record.period].reshape(-1, record.period).mean(0), len(y))
        table = np.column_stack([np.cos(angle[whole]), np.sin(angle[whole])])
        cosine, sine = np.linalg.lstsq(table, y - y.mean(), rcond=None)[0]
        angle = angle + np.arctan2(-sine, cosine)
    return np.column_stack([np.cos(angle), np.sin(angle)])
