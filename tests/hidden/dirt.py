"""Kinds of dirt on a record: what cards, clocks, cables and files do to it after the machine has done its part."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ambid.record import Record

MARGIN = 64
"""Periodic samples before and behind a record that a shift in time reads."""


@dataclass(frozen=True)
class Signals:
    """Arrays (N, axes) of a record while it is made dirty; the period is what the generator repeats."""

    i_e: np.ndarray
    y: np.ndarray
    i_c: np.ndarray | None
    period: int


Dirt = Callable[[Signals, np.random.Generator], Signals]


def shifted(signal: np.ndarray, late: np.ndarray | float) -> np.ndarray:
    """A signal read so many samples late, by a sinc under a Kaiser window; ``late`` may change from row to row."""
    rows, reach = np.arange(len(signal)), 24
    at = rows + np.broadcast_to(late, rows.shape)
    whole = np.floor(at).astype(int)
    out = np.zeros_like(signal)
    for k in range(-reach + 1, reach + 1):
        x = whole + k - at
        weight = np.sinc(x) * np.i0(8.0 * np.sqrt(np.clip(1.0 - (x / reach) ** 2, 0.0, None))) / np.i0(8.0)
        out += weight[:, None] * signal[np.clip(whole + k, 0, len(signal) - 1)]
    return out


def _put(own: Signals, **changed: np.ndarray | None) -> Signals:
    return Signals(**{"i_e": own.i_e, "y": own.y, "i_c": own.i_c, "period": own.period, **changed})


def _row(own: Signals, random: np.random.Generator, first: float = 0.1, last: float = 0.9) -> int:
    return int(random.integers(int(first * len(own.y)), int(last * len(own.y))))


def wrong_i_e(own: Signals, random: np.random.Generator) -> Signals:
    """One sample of the logged i_e is wrong."""
    i_e = own.i_e.copy()
    i_e[_row(own, random), random.integers(i_e.shape[1])] += random.choice([-5.0, 3.0, 0.7]) * np.ptp(i_e)
    return _put(own, i_e=i_e)


def noisy_i_e(own: Signals, random: np.random.Generator) -> Signals:
    """i_e was measured, with 1 % of noise."""
    return _put(own, i_e=own.i_e + 0.01 * own.i_e.std() * random.standard_normal(own.i_e.shape))


def late_i_e(own: Signals, random: np.random.Generator) -> Signals:
    """i_e was logged a sample late."""
    return _put(own, i_e=np.roll(own.i_e, 1, axis=0))


def late_y(own: Signals, random: np.random.Generator) -> Signals:
    """A second card reads y 0.1 to 0.3 samples late."""
    return _put(own, y=shifted(own.y, random.uniform(0.1, 0.3)))


def late_card(own: Signals, random: np.random.Generator) -> Signals:
    """A second card reads y a whole sample late."""
    return _put(own, y=shifted(own.y, 1.0))


def late_i_c(own: Signals, random: np.random.Generator) -> Signals:
    """i_c was read a sample late."""
    return _put(own, i_c=shifted(own.i_c, 1.0))


def drifting_clock(own: Signals, random: np.random.Generator) -> Signals:
    """The clock of the card that reads y and i_c is 100 ppm off that of the generator."""
    late = random.choice([-1e-4, 1e-4]) * np.arange(len(own.y))
    return _put(own, y=shifted(own.y, late), i_c=None if own.i_c is None else shifted(own.i_c, late))


def frozen_y(own: Signals, random: np.random.Generator) -> Signals:
    """One y stands still for 1000 samples."""
    y, row = own.y.copy(), _row(own, random, last=0.8)
    axis = random.integers(y.shape[1])
    y[row : row + 1000, axis] = y[row, axis]
    return _put(own, y=y)


def lost_y(own: Signals, random: np.random.Generator) -> Signals:
    """One sample of y is lost: what follows comes a sample early."""
    y, row = own.y.copy(), _row(own, random)
    y[row:-1] = y[row + 1 :]
    return _put(own, y=y)


def lost_rows(own: Signals, random: np.random.Generator) -> Signals:
    """1 to 20 samples of every channel are lost."""
    row, count = _row(own, random), int(random.integers(1, 21))
    keep = np.r_[:row, row + count : len(own.y)]
    return _put(own, i_e=own.i_e[keep], y=own.y[keep], i_c=None if own.i_c is None else own.i_c[keep])


def spikes(own: Signals, random: np.random.Generator) -> Signals:
    """Five samples of y and i_c are spikes."""
    y, i_c = own.y.copy(), own.i_c.copy()
    for signal in (y, y, y, i_c, i_c):
        signal[_row(own, random), random.integers(y.shape[1])] += random.choice([-1.0, 1.0]) * 4.0 * signal.std()
    return _put(own, y=y, i_c=i_c)


def clipped_y(own: Signals, random: np.random.Generator) -> Signals:
    """One y is clipped at 70 % of its largest value."""
    y = own.y.copy()
    axis = random.integers(y.shape[1])
    middle, most = y[:, axis].mean(), 0.7 * np.abs(y[:, axis] - y[:, axis].mean()).max()
    y[:, axis] = np.clip(y[:, axis], middle - most, middle + most)
    return _put(own, y=y)


def scaled_y(own: Signals, random: np.random.Generator) -> Signals:
    """y is 5 % too large."""
    return _put(own, y=1.05 * own.y)


def twelve_bits(own: Signals, random: np.random.Generator) -> Signals:
    """Every channel has 12 bits over twice its largest value."""

    def rounded(x: np.ndarray) -> np.ndarray:
        step = 4.0 * np.abs(x).max() / 2**12
        return step * np.rint(x / step)

    return _put(own, i_e=rounded(own.i_e), y=rounded(own.y), i_c=None if own.i_c is None else rounded(own.i_c))


def without_i_c(own: Signals, random: np.random.Generator) -> Signals:
    """i_c was not recorded."""
    return _put(own, i_c=None)


def clean(own: Signals, random: np.random.Generator) -> Signals:
    """Nothing at all, to compare with."""
    return own


DIRT: Mapping[str, Dirt] = {
    own.__name__: own
    for own in (
        clean, wrong_i_e, noisy_i_e, late_i_e, late_y, late_card, late_i_c,
        drifting_clock, frozen_y, lost_y, lost_rows, spikes, clipped_y, scaled_y, twelve_bits, without_i_c,
    )
}  # fmt: skip
NOISE_FREE = "noise_free"
"""A kind of its own: the simulator makes it."""
DELAYED: Mapping[str, tuple[float, float]] = {
    "delayed_y": (1.0, 0.0),
    "delayed_i_c": (0.0, 1.0),
    "delayed_i_e": (-1.0, -1.0),
}
"""Cards that are late by any time: how y and i_c are then read late. The simulator reads i_c, which is not smooth."""
DELAYS = 0.1, 20.0
"""Samples."""


def soiled(record: Record, kind: str, random: np.random.Generator, rig) -> Record:
    """The record as a file of it would be loaded after one kind of dirt."""
    made = DIRT.get(kind, clean)(Signals(record.i_e, record.y, record.i_c, record.period), random)
    inner = slice(MARGIN, -MARGIN)
    return Record.from_arrays(
        i_e=made.i_e[inner],
        y=made.y[inner],
        i_c=None if made.i_c is None else made.i_c[inner],
        sample_rate=rig.sample_rate,
        axes=rig.axes,
        rig=rig,
    )
