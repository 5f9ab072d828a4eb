"""The part of a record that is judged, and its lines.

The signal over M whole periods of N samples is Fourier transformed, R(l) = FFT(r)_l / sqrt(M N). The excited lines
l = M k hold what repeats, all others only noise. Without periods every line is excited.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.record import Record

__all__ = ["Window"]

SLOWEST = 8
"""Cycles per record below which a record without periods is not judged: there stands what drifts."""


@dataclass(frozen=True)
class Window:
    """The part of a record that counts: whole periods after the transient, or, with one "period", all after it.

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
    first: int
    lowest: int = 1

    @classmethod
    def after_first(cls, period: int, periods: int) -> Window:
        """So many periods after the first one, which holds the transient."""
        return cls(period, periods, period)

    @classmethod
    def of(cls, record: Record) -> Window:
        """The periods of a record after the first; of a record without periods, all but its first eighth.

        Raises
        ------
        RecordError
            If the record repeats fewer than three times.
        """
        if record.period is None:
            first = record.samples // 8
            return cls(record.samples - first, 1, first, SLOWEST)
        if record.periods < 3:
            raise RecordError(
                f"{record.path or record.name}: {record.periods} periods of the excitation; the misfit in noise units "
                "needs 3 or more. Record more periods, or state the period."
            )
        return cls.after_first(record.period, record.periods - 1)

    @property
    def is_periodic(self) -> bool:
        """Whether there are lines that are not excited."""
        return self.periods > 1

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
        """The same, counted in cycles per period."""
        return np.arange(self.lowest, (self.period + 1) // 2)

    def cut(self, signal: FloatArray) -> FloatArray:
        """The samples that count, of a signal that starts with the record."""
        return signal[self.first : self.first + self.samples]

    def lines(self, signal: FloatArray) -> ComplexArray:
        """R(l) for l = 0 .. M N / 2 of a signal of shape (samples, ...), which starts with the record."""
        return rfft(self.cut(signal), axis=0) / np.sqrt(self.samples)

    def some_lines(self, signal: FloatArray, more: NDArray[np.intp]) -> ComplexArray:
        """R(l) of the excited lines, then of a few more; the mean over the periods holds all that is excited."""
        part = self.cut(signal)
        folded = part.reshape(self.periods, self.period, *part.shape[1:]).sum(axis=0)
        lines = rfft(folded, axis=0)[self.in_period]
        if len(more):
            angles = 2.0 * np.pi / self.samples * np.outer(more, np.arange(self.samples))
            flat = part.reshape(self.samples, -1)
            others = np.cos(angles) @ flat - 1j * (np.sin(angles) @ flat)
            lines = np.concatenate([lines, others.reshape(len(more), *part.shape[1:])])
        return lines / np.sqrt(self.samples)
