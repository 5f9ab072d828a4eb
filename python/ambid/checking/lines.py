"""Spectra of a record on its excited lines, which equations are held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ambid.arrays import ComplexArray, FloatArray
from ambid.noise.window import Window
from ambid.record import Record

HIGHEST_FREQUENCY = 0.25
"""Lines up to this part of the sample rate count."""
BLURRED = 16
"""Lowest line that counts of a record without periods: below it are what drifts, and a window that blurs an integral's
1/f by more than a hundredth."""
CLEAR = 30.0
"""Power of an excited line over that of noise from which on it is clear of it."""
AROUND = 31
"""Unexcited lines that give the power of noise at a line."""
FEWEST_LINES = 16
"""Lines that an equation is fitted to at least: twice as many numbers as the up to 15 unknowns of a controller's."""
MOST_LINES = 8000
"""Lines that an equation is held against, at most."""


@dataclass(frozen=True)
class Lines:
    """Spectra of one record on its excited lines, after the first period; over all of it where it has no periods.

    Attributes
    ----------
    frequency_hz : ndarray, shape (lines,)
    i_e, y : ndarray, shape (lines, axes)
        [A], [m], up to a common factor.
    i_c : ndarray, shape (lines, axes), or None
    r : ndarray, shape (lines, axes)
        Of the reference [m]; zero where there is none.
    index : ndarray, shape (lines,)
        Number of each line among those of `window` samples; the first is 1.
    window : int
        Samples of one period, or of the record without periods.
    whole_periods : bool
    clear : ndarray of bool, shape (lines, axes), or None
        Which of them y fills by far more than noise; None where there are no periods to show it.
    are_responses : bool
        See `of_responses`.
    """

    frequency_hz: FloatArray
    i_e: ComplexArray
    y: ComplexArray
    i_c: ComplexArray | None
    r: ComplexArray
    index: NDArray[np.intp]
    window: int
    whole_periods: bool
    clear: NDArray[np.bool_] | None = None
    are_responses: bool = False

    def some(self, kept: NDArray[np.bool_]) -> Lines:
        """Some of the lines."""
        i_c = None if self.i_c is None else self.i_c[kept]
        own = (self.frequency_hz[kept], self.i_e[kept], self.y[kept], i_c, self.r[kept], self.index[kept])
        return Lines(*own, self.window, self.whole_periods, None if self.clear is None else self.clear[kept])

    @classmethod
    def of(cls, record: Record) -> Lines:
        """Lines of a record with i_e; where there are many, of neighbours the strongest of what drives it."""
        window, length = None, record.samples
        if record.period is not None and record.periods >= 2:
            window, length = Window.of(record).settled, record.period

        def spectrum(signal: FloatArray) -> ComplexArray:
            if window is not None:
                return window.lines(signal)[window.excited]
            return np.fft.rfft((signal - signal.mean(axis=0)) * np.hanning(len(signal))[:, None], axis=0)[1:]

        i_e = spectrum(np.asarray(record.i_e))
        r = np.zeros_like(i_e) if record.r is None else spectrum(record.r)
        size = np.abs(i_e).max(initial=0.0) / (np.abs(r).max(initial=0.0) or 1.0)
        drives = np.hstack([i_e, (size or 1.0) * r])
        drives = drives[:, np.any(drives, axis=0)]
        index = np.arange(1, len(i_e) + 1)
        frequency = index * record.sample_rate / length
        power = np.linalg.norm(drives, axis=1)
        usable = (index >= (BLURRED if window is None else 1)) & (frequency < HIGHEST_FREQUENCY * record.sample_rate)
        kept = np.flatnonzero(usable & (power > 1e-3 * power.max(initial=0.0)))
        own = -(-MOST_LINES // max(1, drives.shape[1]))  # of every axis: each may be excited on lines of its own
        kept = np.unique(np.concatenate([kept[:0], *(_strongest(kept, column, own) for column in np.abs(drives).T)]))
        i_c = None if record.i_c is None else spectrum(record.i_c)[kept]
        y = spectrum(record.y)[kept]
        clear = None if window is None else _clear_of_noise(window, record.y, y, kept)
        return cls(frequency[kept], i_e[kept], y, i_c, r[kept], index[kept], length, window is not None, clear)

    @classmethod
    def of_responses(cls, record: Record) -> Lines:
        """What follows the excitation of a record without periods: a row a frequency and input that moves alone.

        What the record began with leaks into its spectra, but not into the local polynomials of its responses. Rows are
        divided by the std of y.

        Raises
        ------
        RecordError
            If the record is too short for them.
        """
        found, axes = record.frequency_response(), len(record.axes)
        low = found.frequency_hz < HIGHEST_FREQUENCY * record.sample_rate
        names = [f"{signal}.{axis}" for signal in ("i_e", "r") for axis in record.axes]
        drives = np.tile(np.eye(len(names), dtype=complex)[[names.index(own) for own in found.inputs]], (low.sum(), 1))
        of_pairs = found.response[low].swapaxes(1, 2).reshape(len(drives), -1)
        weight = 1.0 / np.linalg.norm(found.std[low, :axes], axis=1).reshape(-1, 1)
        h, drives = weight * of_pairs, weight * drives
        return cls(
            np.repeat(found.frequency_hz[low], len(found.inputs)),
            drives[:, :axes],
            h[:, :axes],
            None if record.i_c is None else h[:, axes:],
            drives[:, axes:],
            np.arange(1, len(h) + 1),
            record.samples,
            whole_periods=False,
            are_responses=True,
        )


def _strongest(lines: NDArray[np.intp], power: FloatArray, count: int) -> NDArray[np.intp]:
    """Of as many blocks of neighbours as `count` the strongest line each, of those that hold some power."""
    lines = lines[power[lines] > 1e-3 * power.max()]
    blocks = np.array_split(lines, min(count, len(lines))) if len(lines) else []
    return np.array([block[np.argmax(power[block])] for block in blocks], dtype=np.intp)


def _clear_of_noise(
    window: Window, signal: FloatArray, excited: ComplexArray, kept: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Which excited lines of which columns stand above the unexcited ones around them."""
    between = window.between(1)
    noise = uniform_filter1d(np.abs(window.lines(signal)[between]) ** 2, AROUND, axis=0, mode="nearest")
    here = np.minimum(np.searchsorted(between, window.excited[kept]), len(between) - 1)
    return np.asarray(np.abs(excited) ** 2 > CLEAR * noise[here])


def times(response: ComplexArray, signal: ComplexArray) -> ComplexArray:
    """A response applied to a signal, line by line."""
    return (response @ signal[..., None])[..., 0]


def moves(columns: ComplexArray) -> NDArray[np.bool_]:
    """Which columns carry more than a few per cent of the strongest."""
    size = np.linalg.norm(columns, axis=0)
    return size > 0.03 * size.max()
