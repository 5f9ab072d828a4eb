"""A record in the frequency domain, before any model."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ambid.arrays import ComplexArray, FloatArray
from ambid.noise.in_time import Folded
from ambid.noise.window import DampedWindow, Window
from ambid.record import Record
from ambid.record.rounding import step_of


class Measured:
    """A record in the frequency domain, before any model.

    Parameters
    ----------
    record : Record
    damping : float
        Rate at which its samples fade away [1/s].
    """

    def __init__(self, record: Record, damping: float = 0.0) -> None:
        self.record, self.window = record, Window.of(record)
        if damping:
            self.window = DampedWindow.like(self.window, damping / record.sample_rate)
        self.channels = len(record.channels)
        self.folded: Folded = {}  # what was simulated of it
        self.judged: dict[Any, Any] = {}  # its lines in the noise that models leave

    def __getstate__(self) -> dict[str, Any]:
        """All but what was simulated by compiled loops, and what is computed again."""
        return {"record": self.record, "window": self.window, "channels": self.channels, "folded": {}, "judged": {}}

    @cached_property
    def excited(self) -> ComplexArray:
        """Excited lines of the outputs that are judged, shape (lines, p)."""
        return np.hstack([self.window.excited_lines(part) for part in self.record.parts])

    @cached_property
    def quiet(self) -> ComplexArray:
        """All lines of the outputs over the periods that noise is taken from, shape (lines, p)."""
        settled, first = self.window.settled, 0
        lines = np.empty((settled.samples // 2 + 1, self.channels), dtype=complex)
        for part in self.record.parts:  # one by one: of a long record all are large
            lines[:, first : first + part.shape[1]] = settled.lines(part)
            first += part.shape[1]
        return lines

    def single(self, index: NDArray[np.intp]) -> ComplexArray:
        """A few lines of the outputs, shape (lines, p)."""
        return np.hstack([self.window.single_lines(part, index) for part in self.record.parts])

    @cached_property
    def rounding(self) -> FloatArray:
        """Power that rounding by the converters adds to the judged lines of each channel, shape (p,)."""
        settled = self.window.settled
        if settled.is_periodic:
            quiet = self.quiet[settled.between(1)]
            power = np.median(np.abs(quiet) ** 2, axis=0) / np.log(2.0)
        else:
            power = np.full(self.channels, np.inf)  # then the residual of excited lines gives all of it
        columns = (column for part in self.record.parts for column in part.T)
        own = [repeated_rounding(x, float(noise)) for x, noise in zip(columns, power, strict=True)]
        return self.window.periods * np.array(own)


BITS = 16
"""Of the converters of measuring cards; the better ones have noise of their own above that."""


def repeated_rounding(x: FloatArray, power: float) -> float:
    """Mean square of the rounding error of a channel that repeats with its signal, so that no unexcited line shows it.

    A value rounded to steps q is off by an error of power q^2/12. Noise of deviation sigma before the converter makes
    most of that error different in every period; the part that repeats is

        rho(sigma/q) = 6/pi^2 sum over k of exp(-4 pi^2 k^2 sigma^2/q^2) / k^2

    (Widrow, Kollar, Quantization Noise, 2008, chapters 5 and 6), which beyond sigma = 0.4 q is nothing. No record is
    taken to be finer than `BITS` of what it spans: there a simulated one without noise has its floor.

    Parameters
    ----------
    x : ndarray, shape (N,)
    power : float
        Of its noise as recorded, mean square.
    """
    step = max(step_of(x), float(np.ptp(x)) / 2**BITS)
    relative = power / step**2

    def excess(before: float) -> float:
        """Noise before the converter and what of its rounding does not repeat, less what the record has."""
        return before + (1.0 - _repeated_share(before)) / 12.0 - relative

    before = float(brentq(excess, 0.0, relative)) if np.isfinite(relative) and relative > 0.0 else relative
    return _repeated_share(before) * step**2 / 12.0


def _repeated_share(before: float) -> float:
    """rho for noise of this power before the converter, in squares of its step."""
    k = np.arange(1, 50)
    return 6.0 / np.pi**2 * float(np.sum(np.exp(-4.0 * np.pi**2 * k**2 * before) / k**2)) if before > 0.0 else 1.0
