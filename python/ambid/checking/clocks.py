"""Does y keep in step with a periodic excitation? A clock that runs off, and samples that y alone lost.

In short stretches y is held against its own mean period x: ``y(t) - x(t) = s(t) dx/dt``. A shift s that grows steadily
is another clock; one that jumps by whole samples, and stays, is samples lost or repeated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambid.arrays import FloatArray
from ambid.noise.window import Window
from ambid.record import Record

__all__ = ["Clock", "Jump", "out_of_step"]

STRETCHES = 8
"""Stretches of a period in each of which a shift is found."""
SURE = 100.0
"""Fall of the weighted sum of squares of shifts by a ramp or a jump: ten standard errors."""
OWN_SHARE = 0.5
"""Part of what does not repeat that a shift must explain: physics that changes moves y by more than its phase."""
CLEAN = 0.9
"""Part of the scatter of the shifts that a ramp or one jump must explain: a transient that dies away over the periods,
or noise of a narrow band, leaves more."""
LEAST_CLOCK = 2e-6
"""Difference of two clocks that is told; that of two quartzes is 1e-5 and more."""
WHOLE = 0.15
"""How near to whole samples a jump must be."""


@dataclass(frozen=True)
class Clock:
    """The clock of y runs fast by this part against that of i_e."""

    fast: float


@dataclass(frozen=True)
class Jump:
    """One axis of y comes earlier by so many samples from a row on, counted from 0."""

    axis: int
    row: int
    samples: int


def out_of_step(record: Record) -> list[Clock | Jump]:
    """What makes y run out of step with the excitation.

    Parameters
    ----------
    record : Record
        Anything is found in three periods or more only.

    Returns
    -------
    list of Clock or Jump
        One `Clock`, a `Jump` an axis, or nothing.
    """
    if record.period is None or record.periods < 3:
        return []
    window = Window.of(record).settled
    length = max(16, window.period // STRETCHES)
    clocks: list[Clock] = []
    jumps: list[Jump] = []
    for axis, y in enumerate(record.y.T):
        begun, shift, weight, power = _shifts(window.cut(y), window.period, length)
        ramp, by_ramp = _ramp(begun, shift, weight)
        jump, place, by_jump = _jump(shift, weight)
        explained = max(by_ramp, by_jump)
        left = (power - explained) / len(window.cut(y))
        scatter = float(weight @ (shift - np.average(shift, weights=weight)) ** 2)
        if explained < max(OWN_SHARE * power, SURE * left, CLEAN * scatter):
            continue
        if by_ramp >= by_jump and abs(ramp) > LEAST_CLOCK:
            clocks.append(Clock(float(ramp)))
        elif by_jump > by_ramp and abs(jump) > 0.5 and abs(jump - round(jump)) < WHOLE:
            jumps.append(Jump(axis, window.first + place * length, round(jump)))
    return [Clock(float(np.median([own.fast for own in clocks])))] if clocks else list(jumps)


def _shifts(y: FloatArray, period: int, length: int) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Of each stretch the beginning of its period, its shift to earlier times in samples and the weight of that; then
    the power that does not repeat."""
    usual = y.reshape(-1, period).mean(axis=0)
    lines = np.fft.rfft(usual)
    slope = np.fft.irfft(2j * np.pi * np.arange(len(lines)) / period * lines, n=period)
    apart = y - np.tile(usual, len(y) // period)
    slope = np.tile(slope, len(y) // period)
    count = len(y) // length
    slope, apart = (z[: count * length].reshape(count, length) for z in (slope, apart))
    apart = apart - apart.mean(axis=1)[:, None]
    weight = np.maximum(np.sum(slope**2, axis=1), 1e-300)
    begun = np.arange(count) * length // period * period  # the mean period has what happens within one
    return begun.astype(float), np.sum(slope * apart, axis=1) / weight, weight, float(np.sum(apart**2))


def _ramp(at: FloatArray, shift: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Slope of the shift over time, and the power that it explains."""
    middle = at - np.average(at, weights=weight)
    own = shift - np.average(shift, weights=weight)
    size = float(np.sum(weight * middle**2))
    slope = float(np.sum(weight * middle * own)) / size
    return slope, slope**2 * size


def _jump(shift: FloatArray, weight: FloatArray) -> tuple[float, int, float]:
    """Size of the one jump that explains most, the stretch that it comes before, and the power that it explains."""
    best = (0.0, 0, 0.0)
    for k in range(1, len(shift)):
        before, after = weight[:k].sum(), weight[k:].sum()
        size = float(np.average(shift[k:], weights=weight[k:]) - np.average(shift[:k], weights=weight[:k]))
        power = size**2 * before * after / (before + after)
        if power > best[2]:
            best = (size, k, float(power))
    return best
