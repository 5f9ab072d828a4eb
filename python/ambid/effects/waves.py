"""Inputs at one frequency, and which of them turn with the rotor."""

from collections.abc import Sequence
from functools import partial
from math import pi

import numpy as np
from scipy.fft import rfft

from ambid.arrays import FloatArray, stacked
from ambid.loop.effect import Effect, Seen, Tone
from ambid.record import Record
from ambid.rig import Rig

BARELY = 0.05
"""Part of a line from an excited one within which a wave leaves next to nothing between them, as a transient does."""
OFF_SPEED = 0.02
"""Part by which a tone may lie off a multiple of the speed of the rig file and still be called synchronous."""
MOST_HARMONICS = 10
"""Times the frequency of rotation, up to which a line is one of the rotor's surface."""
NEAR = 12
"""Lines to each side of a frequency, for each excitation and once more, that give a response."""


class Wave(Effect):
    """An effect of one frequency, whose parameters are pairs of parts a quarter period apart, one pair a place."""

    reference: int

    def quarters(self, rig: Rig) -> Sequence[tuple[str, str]]:
        """Both parts at every place."""
        names = [p.name for p in self.parameters(rig)]
        return list(zip(names[::2], names[1::2], strict=True))

    def waveform(self, rig: Rig, samples: int, record: Record | None) -> FloatArray:
        """Cosine and sine at its frequency."""
        return cosine_and_sine(self.frequencies_hz(rig)[0], rig.sample_rate, samples, record, self.reference)


def is_synchronous(tone: Tone, seen: Seen) -> bool:
    """Whether a tone turns with the rotor, at one of the speeds that there are records of."""
    return harmonic(tone, seen) == 1


def harmonic(tone: Tone, seen: Seen) -> int:
    """How many times the frequency of rotation a tone has, at one of the speeds that there are records of; or 0."""
    for speed in sorted(seen.speeds - {0.0}):
        times = 2.0 * pi * tone.frequency_hz / speed
        if 0 < round(times) <= MOST_HARMONICS and abs(times - round(times)) < OFF_SPEED * round(times):
            return round(times)
    return 0


def cosine_and_sine(
    frequency: float, sample_rate: float, samples: int, record: Record | None, reference: int
) -> FloatArray:
    """Cosine and sine, shape (samples, 2), that count their angle from that of a record's displacement or current.

    The start of a record has no fixed angle to the rotor or to the mains; what one channel holds at that frequency has.
    `reference` counts y of all axes, then i_c of all axes; where one of them was not recorded, the
    other stands for it, and where neither was, the further channels do.
    """
    angle = 2.0 * pi * frequency / sample_rate * np.arange(samples)
    if record is not None:
        usual = record.y if record.i_c is None else np.hstack([record.y, record.i_c])
        signals = usual if usual.size else record.outputs
        own = signals[:, [reference % signals.shape[1]]]
        table = np.column_stack([np.cos(angle), np.sin(angle)])[: len(own)]
        rows = _between_excited if _is_apart(frequency, record) else partial(_beside_excitation, frequency=frequency)
        both = rows(np.hstack([table, own]), record)
        cosine, sine = np.linalg.lstsq(both[:, :2], both[:, 2])[0]
        angle = angle + np.arctan2(-sine, cosine)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _is_apart(frequency: float, record: Record) -> bool:
    """Whether a frequency is far enough from any excited line to be distinguished from it."""
    if record.period is None or record.periods < 2:
        return False
    place = frequency / record.sample_rate * record.period
    return abs(place - round(place)) * record.periods > BARELY


def _between_excited(columns: FloatArray, record: Record) -> FloatArray:
    """What does not repeat with the excitation, without the first period where two others remain."""
    assert record.period is not None, "asked of periods"
    first = record.period if record.periods > 2 else 0
    own = columns[first : record.periods * record.period].reshape(-1, record.period, columns.shape[1])
    return np.asarray((own - own.mean(axis=0)).reshape(-1, columns.shape[1]))


def _beside_excitation(columns: FloatArray, record: Record, frequency: float) -> FloatArray:
    """Lines around a frequency, real and imaginary parts, without what is smooth there, or a smooth response.

    Over so few lines a response to the excitation, and a transient, are straight: the local polynomial method, see
    Pintelon, Schoukens, System Identification, 2nd ed., chapter 7.
    """
    drives = [part[:, np.ptp(part, axis=0) > 0.0] for part in (record.i_e, record.r) if part is not None]
    inputs = np.hstack(drives) if drives else np.zeros((record.samples, 0))
    reach = NEAR * (1 + inputs.shape[1])
    middle = round(frequency / record.sample_rate * record.samples)
    near = np.arange(max(1, middle - reach), min(middle + reach, (record.samples - 1) // 2) + 1)
    own, driven = (rfft(part, axis=0)[near] for part in (columns, inputs))
    slope = ((near - middle) / reach)[:, None]
    smooth = np.hstack([np.ones_like(slope), slope, driven, slope * driven])
    left = own - smooth @ np.linalg.lstsq(smooth, own, rcond=None)[0]
    return stacked(left)
