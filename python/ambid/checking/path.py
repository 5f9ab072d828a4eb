"""Does a record pass through operating points: does a set-point, speed or load move it while it is recorded?

Of a record with periods a slow ramp is seen by the means of its periods, whatever the model: in the last half of them,
where a start from elsewhere has died away, they must go on at the same rate.
"""

from __future__ import annotations

import numpy as np

from ambid.arrays import FloatArray
from ambid.checking.soundness import PATH, Finding
from ambid.record import Record

__all__ = ["path"]

PARTS = 8
"""Of a record, whose means of y are held against each other."""
MOVED = 2.0
"""Standard deviations of y within a part by which its mean may move; an excitation moves it by less."""
LEAST_PERIODS = 8
"""Of a record whose periods show a ramp: half of them make a line whose halves are compared."""
CERTAIN = 8.0
"""Standard errors of a ramp's slope."""
EVEN = 0.5
"""Part of a ramp's slope that each half of the line must have: what dies away has less in the second."""
NOTICED = 10.0
"""Rms of the noise over which a ramp must lead: on the tenth line it is then as loud as the noise."""


def path(record: Record) -> list[Finding]:
    """The means of y and i_c stay where they are; where they do not, from where to where they go.

    A free response, which comes to rest, is none.
    """
    told = "" if record.is_free_response else _ramps(record) or _moves(record)
    if not told:
        return []
    what = f"{told}: the record passes through operating points, which is no drift of the machine, but hides what is "
    what += "missing"
    todo = "cut it where it stands (Record.rows), and give each part the rig of its operating point"
    return [Finding("warning", f"{record.name}: {PATH}", what, todo)]


def _ramps(record: Record) -> str:
    """Channels that go on slowly at one rate through the last half of the periods."""
    if record.period is None or record.periods < LEAST_PERIODS:
        return ""
    periods = record.outputs[: record.periods * record.period].reshape(record.periods, record.period, -1)
    means, late = periods.mean(axis=1), periods[record.periods // 2 :]
    change = np.diff(late, axis=0)
    noise = np.sqrt(np.mean((change - change.mean(axis=1, keepdims=True)) ** 2, axis=(0, 1)) / 2.0)
    line = late.mean(axis=1)
    (slope, error), middle = _slope(line), len(line) // 2
    first, second = _slope(line[:middle])[0], _slope(line[middle:])[0]
    is_even = np.minimum(first * slope, second * slope) > EVEN * slope**2
    leads = np.abs(slope) * record.periods > NOTICED * noise
    ramps = np.flatnonzero(is_even & leads & (np.abs(slope) > CERTAIN * error))
    return " and ".join(_from_to(record, int(k), means[1, k], means[-1, k]) for k in ramps)


def _moves(record: Record) -> str:
    """The axis whose mean of y moves most from part to part, by more than an excitation moves it."""
    parts = np.array_split(record.y, PARTS)
    means, within = (
        np.array([part.mean(axis=0) for part in parts]),
        np.mean([part.std(axis=0) for part in parts], axis=0),
    )
    far = np.ptp(means, axis=0)
    j = int(np.argmax(far / within))
    return "" if far[j] < MOVED * within[j] else _from_to(record, j, means[0, j], means[-1, j], far[j])


def _from_to(record: Record, channel: int, begin: float, end: float, far: float | None = None) -> str:
    name = record.channels[channel]
    factor, unit = (1e6, "um") if name.startswith("y.") else (1.0, "A")
    over = "" if far is None or far < 1.1 * abs(end - begin) else f", over {_digits(factor * far)} {unit}"
    return f"{name} goes from {_digits(factor * begin)} to {_digits(factor * end)} {unit}{over}"


def _digits(value: float) -> str:
    """Four digits, and no power of ten."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"


def _slope(means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope of each column by its row, and its standard error."""
    at = np.arange(len(means)) - 0.5 * (len(means) - 1)
    slope = at @ means / (at @ at)
    left = means - means.mean(axis=0) - at[:, None] * slope
    error = np.sqrt(np.sum(left**2, axis=0) / max(len(means) - 2, 1) / (at @ at))
    return slope, error
