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
    """Cosine and sine, shape (samples, 2), that count their angle from that of a record's displacement or current.

    The start of a record has no fixed angle to the rotor or to the mains; what one channel holds at that frequency has.
    `reference` counts y of all axes, then i_c of all axes; where i_c was not recorded, y stands for it.
    """
    angle = 2.0 * pi * frequency / sample_rate * np.arange(samples)
    if record is not None:
        signals = record.y if record.i_c is None else np.hstack([record.y, record.i_c])
        own = signals[:, [reference % signals.shape[1]]]
        table = np.column_stack([np.cos(angle), np.sin(angle)])[: len(own)]
        cosine, sine = np.linalg.lstsq(_between_excited(table, record), _between_excited(own, record)[:, 0])[0]
        angle = angle + np.arctan2(-sine, cosine)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _between_excited(columns: FloatArray, record: Record) -> FloatArray:
    """What does not repeat with the excitation, without the first period where two others remain."""
    if record.period is None or record.periods < 2:
        return columns - columns.mean(axis=0)
    first = record.period if record.periods > 2 else 0
    own = columns[first : record.periods * record.period].reshape(-1, record.period, columns.shape[1])
    return np.asarray((own - own.mean(axis=0)).reshape(-1, columns.shape[1]))
