"""A record in the frequency domain, before any model."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ComplexArray, FloatArray
from ambid.noise.converter import repeated_rounding
from ambid.noise.damped import DampedWindow
from ambid.noise.in_time import Folded
from ambid.noise.window import Window
from ambid.record import Record

__all__ = ["Measured"]


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

    def __getstate__(self) -> dict[str, Any]:
        """All but what was simulated by compiled loops, and what is told again."""
        return {"record": self.record, "window": self.window, "channels": self.channels, "folded": {}}

    @cached_property
    def excited(self) -> ComplexArray:
        """Excited lines of y and i_c that are judged, shape (lines, p)."""
        return np.hstack([self.window.excited_lines(part) for part in self.record.parts])

    @cached_property
    def quiet(self) -> ComplexArray:
        """All lines of y and i_c over the periods that noise is taken from, shape (lines, p)."""
        settled, axes = self.window.settled, len(self.record.axes)
        lines = np.empty((settled.samples // 2 + 1, self.channels), dtype=complex)
        for k, part in enumerate(self.record.parts):  # one by one: of a long record both are large
            lines[:, k * axes : (k + 1) * axes] = settled.lines(part)
        return lines

    def single(self, index: NDArray[np.intp]) -> ComplexArray:
        """A few lines of y and i_c, shape (lines, p)."""
        return np.hstack([self.window.single_lines(part, index) for part in self.record.parts])

    @cached_property
    def rounding(self) -> FloatArray:
        """Power that rounding by the converters adds to the judged lines of each channel, shape (p,)."""
        settled = self.window.settled
        if settled.is_periodic:
            quiet = self.quiet[settled.between(1)]
            power = np.median(np.abs(quiet) ** 2, axis=0) / np.log(2.0)
        else:
            power = np.full(self.channels, np.inf)  # then what is left of excited lines tells all of it
        columns = (column for part in self.record.parts for column in part.T)
        own = [repeated_rounding(x, float(noise)) for x, noise in zip(columns, power, strict=True)]
        return self.window.periods * np.array(own)
