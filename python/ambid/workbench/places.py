"""What a call of the page points at: a record, a channel, an excitation, and a chart so many pixels wide.

Of long signals every pixel shows the smallest and the largest sample, so that no peak is lost.
"""

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.errors import InputError
from ambid.noise import Comparison
from ambid.workbench.session import Session

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


def thinned(signals: FloatArray, pixel: NDArray[np.intp]) -> NDArray[np.intp]:
    """Which samples to draw: those where a signal is smallest or largest within a pixel, and both ends.

    Parameters
    ----------
    signals : ndarray, shape (N, k)
        Drawn over the same samples; NaN where there is nothing.
    pixel : ndarray of int, shape (N,)
        Which pixel each sample falls in, rising.

    Returns
    -------
    ndarray of int
        In order; of a pixel with many equal extremes the first.
    """
    first = np.flatnonzero(np.diff(pixel, prepend=pixel[0] - 1))
    own = np.repeat(np.arange(len(first)), np.diff(first, append=len(pixel)))
    kept = [np.array([0, len(pixel) - 1])]
    for signal in signals.T:
        for least in (signal, -signal):
            reached = np.fmin.reduceat(least, first)[own] == least
            at = np.flatnonzero(reached)
            kept.append(at[np.unique(own[at], return_index=True)[1]])
    return np.asarray(np.unique(np.concatenate(kept)), dtype=np.intp)
