"""The part of a record that is judged, and its lines.

The signal over M whole periods of N samples is Fourier transformed, R(l) = FFT(r)_l / sqrt(M N). The excited lines
l = M k hold what repeats, all others only noise, and what is left of transients. Without periods every line is excited.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind, Where
from ambid.record import Measurement, Record

MOST_LINES = 16_384
"""Lines that are judged of a record without periods, at the most: a second of work and a fifth of a gigabyte of eight
channels, whatever its length. Shorter records, of up to 32 768 samples, are judged on every line."""
THINNED = Kind(
    "frequencies_thinned",
    "note",
    "without periods, {judged} of {frequencies} DFT frequencies are judged: all of the lowest, ever fewer above; "
    "intervals are wider for it",
    "excite periodically, and every sample counts",
)


@dataclass(frozen=True)
class Window:
    """The part of a record that counts: its whole periods, or, with one "period", all of it.

    Attributes
    ----------
    period : int
        Samples N per period.
    periods : int
        Number M of periods that count.
    first : int
        First sample that counts.
    lowest : int
        Cycles per period of the lowest line that is judged.
    """

    period: int
    periods: int
    first: int = 0
    lowest: int = 1

    @classmethod
    def of(cls, record: Record) -> Window:
        """All whole periods of a record; of a record without periods, all of it."""
        if record.period is None:
            # cycles per record below which a record without periods is not judged: there stands what drifts
            return cls(record.samples, 1, 0, 1)
        if record.periods < 2:
            raise RecordError(
                f"{record.path or record.name}: {record.periods} period of the excitation; the misfit in noise units "
                "needs 2 or more. Record more periods, or load the record without a period."
            )
        return cls(record.period, record.periods)

    @property
    def is_periodic(self) -> bool:
        """Whether there are lines that are not excited."""
        return self.periods > 1

    @property
    def settled(self) -> Window:
        """The same without its first period, which may hold a start from rest, where two others remain."""
        if self.periods < 3:
            return self
        return Window(self.period, self.periods - 1, self.first + self.period, self.lowest)

    @property
    def samples(self) -> int:
        """M N."""
        return self.period * self.periods

    @property
    def excited(self) -> NDArray[np.intp]:
        """Indices of the excited lines that are judged, neither DC nor the highest."""
        return self.periods * self.in_period

    @property
    def in_period(self) -> NDArray[np.intp]:
        """The same, counted in cycles per period; without periods at most `MOST_LINES`, see `thinned`."""
        lines = np.arange(self.lowest, (self.period + 1) // 2)
        return lines if self.is_periodic else thinned(lines, MOST_LINES)

    def between(self, most: int) -> NDArray[np.intp]:
        """Indices of at most so many unexcited lines in each gap between excited ones, evenly spread."""
        count = min(most, self.periods - 1)
        steps = np.round(np.arange(1, count + 1) * self.periods / (count + 1)).astype(np.intp)
        lines = (self.periods * np.arange((self.period + 1) // 2)[:, None] + steps).ravel()
        return lines[lines < (self.samples + 1) // 2]

    def points(self, index: NDArray[np.intp]) -> ComplexArray:
        """Lines as points ``exp(2 pi i l / (M N))`` of the unit circle."""
        return np.exp(2j * np.pi * index / self.samples)

    def cut(self, signal: FloatArray) -> FloatArray:
        """The samples that count, of a signal that starts with the record."""
        return signal[self.first : self.first + self.samples]

    def lines(self, signal: FloatArray) -> ComplexArray:
        """R(l) for l = 0 .. M N / 2 of a signal of shape (samples, ...), which starts with the record."""
        lines = rfft(self.cut(signal), axis=0)
        lines /= np.sqrt(self.samples)
        return np.asarray(lines)

    def excited_lines(self, signal: FloatArray) -> ComplexArray:
        """R(l) of the excited lines; the mean over the periods holds all that is excited."""
        part = self.cut(signal)
        if not self.is_periodic:
            return self.of_period(part)
        return self.of_period(part.reshape(self.periods, self.period, *part.shape[1:]).sum(axis=0))

    def single_lines(self, signal: FloatArray, index: NDArray[np.intp]) -> ComplexArray:
        """R(l) of a few lines."""
        part = self.cut(signal)
        turn, flat = 2.0 * np.pi / self.samples * np.arange(self.samples), part.reshape(self.samples, -1)
        lines = np.array([np.cos(l * turn) @ flat - 1j * (np.sin(l * turn) @ flat) for l in index], dtype=complex)
        return lines.reshape(len(index), *part.shape[1:]) / np.sqrt(self.samples)

    def of_period(self, folded: FloatArray) -> ComplexArray:
        """R(l) of the excited lines from the sum over the periods, shape (N, ...)."""
        return rfft(folded, axis=0)[self.in_period] / np.sqrt(self.samples)


def findings_of(record: Measurement) -> tuple[Finding, ...]:
    """What is to be known beside a result of a record on lines: its own findings, and whether lines were left out."""
    found = tuple(own.at(record=record.name) for own in record.findings)
    if not record.is_in_time or record.period is not None:
        return found
    window = Window.of(record)
    judged, there = len(window.excited), (window.period + 1) // 2 - window.lowest
    if judged == there:
        return found
    return (*found, THINNED(Where(record=record.name), judged=judged, frequencies=there))


def thinned(lines: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """At most so many of consecutive lines: all of the lowest, beyond them ever fewer, evenly over log frequency.

    What modes and lags do over frequency spreads in proportion to it, so that the lines that are left see it as well.
    With n lines of which the lowest b are all kept, ``b (1 + ln(n / b))`` remain. What is known of a parameter goes
    with the number of lines where it acts: where one of k is left, its standard error grows by the root of k.
    """
    count = len(lines)
    if count <= most:
        return lines
    low, high = 1.0, float(most)
    while high - low > 0.5:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle * (1.0 + np.log(count / middle)) < most else (low, middle)
    kept = int(low)
    sparse = np.geomspace(kept, count, most - kept, endpoint=False).astype(np.intp)
    return lines[np.unique(np.concatenate([np.arange(kept), sparse]))]


@dataclass(frozen=True)
class DampedWindow(Window):
    """A window in which samples fade away: lines on a circle outside of the unit circle, so that poles are damped more.

    Of ``x[k] exp(-rate t[k])`` the loop on lines holds at ``w exp(rate dt)``, transient included: resonances are wider
    by `rate`, and a loop may grow as fast without being unstable. A fit that the true one's sharp resonances or the
    edge of stability keep away from it finds the way there, and with ever less damping back.

    Attributes
    ----------
    fading : float
        By ``exp(-fading)`` from each sample to the next.
    """

    fading: float = 0.0

    @classmethod
    def like(cls, window: Window, fading: float) -> DampedWindow:
        """The same part of a record."""
        return cls(window.period, window.periods, window.first, window.lowest, fading)

    @property
    def excited(self) -> NDArray[np.intp]:
        """As many lines as the window has else, of all of them: what fades away is felt beside its own line, too."""
        lines = np.arange(self.periods * self.lowest, (self.samples + 1) // 2)
        return lines[:: -(-len(lines) // len(self.in_period))]

    def points(self, index: NDArray[np.intp]) -> ComplexArray:
        """Lines as points of the circle."""
        return np.exp(self.fading) * super().points(index)

    def excited_lines(self, signal: FloatArray) -> ComplexArray:
        """Lines of the fading signal, at the power of noise that lasts."""
        return self.single_lines(signal, self.excited)

    def single_lines(self, signal: FloatArray, index: NDArray[np.intp]) -> ComplexArray:
        """The same of a few lines."""
        part = self.cut(signal)
        faded = np.exp(-self.fading * np.arange(self.samples)).reshape(-1, *[1] * (part.ndim - 1))
        return np.asarray(rfft(part * faded, axis=0)[index] / np.linalg.norm(faded))
