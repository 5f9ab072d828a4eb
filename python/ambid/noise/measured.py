"""A record in the frequency domain, before any model."""

from __future__ import annotations

from functools import cached_property

import numpy as np

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

    @cached_property
    def excited(self) -> ComplexArray:
        """Excited lines of y and i_c that are judged, shape (lines, p)."""
        return self.window.excited_lines(self.record.outputs)

    @cached_property
    def quiet(self) -> ComplexArray:
        """All lines of y and i_c over the periods that noise is taken from, shape (lines, p)."""
        return self.window.settled.lines(self.record.outputs)

    @cached_property
    def rounding(self) -> FloatArray:
        """Power that rounding by the converters adds to the judged lines of each channel, shape (p,)."""
        settled = self.window.settled
        if settled.is_periodic:
            quiet = self.quiet[settled.between(1)]
            power = np.median(np.abs(quiet) ** 2, axis=0) / np.log(2.0)
        else:
            power = np.full(self.channels, np.inf)  # then what is left of excited lines tells all of it
        columns = self.record.outputs.T
        own = [repeated_rounding(x, float(noise)) for x, noise in zip(columns, power, strict=True)]
        return self.window.periods * np.array(own)
