"""What a call of the page points at: a record, a channel, an excitation, and a chart so many pixels wide."""

from __future__ import annotations

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import InputError
from ambid.noise import Comparison
from ambid.workbench.session import Session

__all__ = ["chart", "column_of", "input_of", "place_of"]

FEWEST_PIXELS, MOST_PIXELS = 50, 4000
"""Widths of a chart that are drawn."""


def place_of(session: Session, record: int) -> tuple[Comparison, int]:
    """The comparison that a record stands in, and where; those to fit come first, then those to validate on.

    Raises
    ------
    InputError
        If there is no such record.
    """
    own, kept = session.comparison, session.kept_back
    count = len(own.records)
    total = count + (0 if kept is None else len(kept.records))
    if not 0 <= record < total:
        raise InputError(f"record = {record}: expected 0 to {total - 1}")
    return (own, record) if kept is None or record < count else (kept, record - count)


def column_of(comparison: Comparison, k: int, channel: str) -> int:
    """Where a channel stands in a record; `InputError` if it has none of this name."""
    names = [row.channel for row in comparison.records[k].channels]
    if channel not in names:
        name = comparison.records[k].record.name
        raise InputError(f"{name}: no channel {channel}; it has {', '.join(names)}")
    return names.index(channel)


def input_of(inputs: tuple[str, ...], inlet: str | None, left: FloatArray) -> int:
    """Where an excitation stands, without a name that whose response is missed most; `InputError` if it is not there.

    `left`, shape (F, inputs), is the size of what the model misses, over its noise.
    """
    if inlet is None:
        return int(np.argmax(np.nansum(left**2, axis=0)))
    if inlet not in inputs:
        raise InputError(f"no response to {inlet}; there are those to {', '.join(inputs)}")
    return inputs.index(inlet)


def chart(pixels: int) -> int:
    """The width of a chart; `InputError` if none is drawn so wide."""
    if not FEWEST_PIXELS <= pixels <= MOST_PIXELS:
        raise InputError(f"pixels = {pixels}: expected {FEWEST_PIXELS} to {MOST_PIXELS}")
    return pixels
