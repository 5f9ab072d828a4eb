"""A record in the frequency domain, before any model."""

from __future__ import annotations

from functools import cached_property

from ambid.arrays import ComplexArray
from ambid.noise.window import Window
from ambid.record import Record

__all__ = ["Measured"]


class Measured:
    """A record in the frequency domain, before any model.

    Parameters
    ----------
    record : Record
    """

    def __init__(self, record: Record) -> None:
        self.record, self.window = record, Window.of(record)
        self.channels = len(record.channels)

    @cached_property
    def quiet(self) -> ComplexArray:
        """All lines of y and i_c over the periods that noise is taken from, shape (lines, p)."""
        return self.window.settled.lines(self.record.outputs)
