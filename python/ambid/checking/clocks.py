"""Does y keep in step with a periodic excitation? A clock that runs off, and samples that y alone lost.

y is held against its own mean period x: ``y(t) - x(t) = s(t) dx/dt``. A shift s that grows steadily is another clock;
one that jumps by whole samples, and stays, is samples lost or repeated, which is sought in short stretches.

A parameter that drifts changes y steadily, too, by ``t dx/dtheta``, in which feedback hides some of dx/dt: the less of
a force error gets through, the lower the frequency. So a clock is reported only where it leaves little of what changes
steadily, and less than the drift of any kind of parameter does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambid.arrays import FloatArray
from ambid.checking.nominal import NominalLoop
from ambid.noise.window import Window
from ambid.record import Record

STRETCHES = 8
"""Stretches of a period in each of which a shift is found."""
SURE = 100.0
"""Fall of the weighted sum of squares of shifts by a ramp or a jump: ten standard errors."""
OWN_SHARE = 0.5
"""Part of what does not repeat that a shift must explain: physics that changes moves y by more than its phase."""
CLEAN = 0.9
"""Part of the scatter of the shifts that one jump must explain: a transient that dies away over the periods, or noise
of a narrow band, leaves more."""
LEFT = 0.25
"""Part of what changes steadily, beyond its noise, that a clock may leave. Of a mass on one axis and a spindle on four,
with 8 excitations whose periods have 2044 to 8064 samples, clocks left up to 0.02, up to 0.06 if 1000 ppm off (126
records that stand out from noise); a K_i that drifts by 2 to 30 % left 0.41 and more (144), and 0.28 at a bandwidth
near the sample rate."""
BETTER = 2.0
"""Power that the best drift of a parameter must leave over that which a clock leaves: where feedback makes them alike,
no clock is reported. In the same records it was 2.6 and more for clocks, and 1.1 and less for drifts."""
LEAST_CLOCK = 2e-6
"""Difference of two clocks that is reported; that of two quartzes is 1e-5 and more."""
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


def out_of_step(record: Record, loop: NominalLoop) -> list[Clock | Jump]:
    """What makes y run out of step with the excitation.

    Parameters
    ----------
    record : Record
        Anything is found in three periods or more only.
    loop : NominalLoop
        Of its rig: what a drift of its parameters would do.

    Returns
    -------
    list of Clock or Jump
        One `Clock`, a `Jump` an axis, or nothing.
    """
    if record.period is None or record.periods < 3:
        return []
    window = Window.of(record).settled
    length = max(16, window.period // STRETCHES)
    if len(window.cut(record.y)) < 2 * length:
        return []
    jumps: list[Jump] = []
    sure_ramps, powers = False, np.zeros(2)
    for axis, y in enumerate(record.y.T):
        begun, shift, weight, power = _shifts(window.cut(y), window.period, length)
        by_ramp, (jump, place, by_jump) = _ramp(begun, shift, weight), _jump(shift, weight)
        explained = max(by_ramp, by_jump)
        left = (power - explained) / len(window.cut(y))
        powers += by_ramp, by_jump
        sure_ramps |= by_ramp > SURE * left
        scatter = float(weight @ (shift - np.average(shift, weights=weight)) ** 2)
        if explained < max(OWN_SHARE * power, SURE * left, CLEAN * scatter):
            continue
        if by_jump > by_ramp and abs(jump) > 0.5 and abs(jump - round(jump)) < WHOLE:
            own = Change.of(window, record.y[:, [axis]])
            drifts = [[pattern[:, [axis]] for pattern in kind] for kind in _drifts(record, window, loop)]
            if all(own.times * (own.power - own.left(kind)) < by_jump for kind in drifts):
                jumps.append(Jump(axis, window.first + place * length, round(jump)))
    clock = _clock(record, window, loop) if sure_ramps and powers[0] >= powers[1] else None
    return list(jumps) if clock is None else [clock]


@dataclass(frozen=True)
class Change:
    """What changes steadily from period to period.

    Attributes
    ----------
    usual, each : ndarray, shape (samples, columns)
        The mean period, and what a period has more than the one before.
    times : float
        Power of such a change over all periods, over that of `each`.
    noise : float
        Power that noise has in `each`; 0 where two periods do not show it.
    """

    usual: FloatArray
    each: FloatArray
    times: float
    noise: float

    @classmethod
    def of(cls, window: Window, signal: FloatArray) -> Change:
        """By least squares."""
        periods = _periods(window, signal)
        at, usual = np.arange(window.periods) - 0.5 * (window.periods - 1), periods.mean(axis=0)
        times = float(at @ at)
        each = np.tensordot(at, periods, 1) / times
        rest = periods - usual - at[:, None, None] * each
        return cls(usual, each, times, float(np.sum(rest**2)) / max(1, window.periods - 2) / times)

    @property
    def power(self) -> float:
        """Of `each`."""
        return float(np.sum(self.each**2))

    def left(self, patterns: list[FloatArray]) -> float:
        """Power that patterns leave of it, each with the size that leaves least."""
        columns = np.stack([pattern.ravel() for pattern in patterns], axis=1)
        sizes = np.linalg.lstsq(columns, self.each.ravel(), rcond=None)[0]
        return float(np.sum((self.each.ravel() - columns @ sizes) ** 2))


def _clock(record: Record, window: Window, loop: NominalLoop) -> Clock | None:
    """The clock of y, where it explains what changes steadily, and no parameter does."""
    change = Change.of(window, record.y)
    lines = np.fft.rfft(change.usual, axis=0)
    slope = np.fft.irfft(2j * np.pi * np.arange(len(lines))[:, None] / window.period * lines, n=window.period, axis=0)
    fast = -float(np.sum(slope * change.each) / max(np.sum(slope**2), 1e-300)) / window.period
    power, noise, left = change.power, change.noise, change.left([slope])
    if abs(fast) < LEAST_CLOCK or left - noise > LEFT * (power - noise) or power < BETTER * left:
        return None
    rivals = [change.left(kind) for kind in _drifts(record, window, loop)]
    return Clock(fast) if min(rivals, default=power) > BETTER * left else None


def _periods(window: Window, signal: FloatArray) -> FloatArray:
    """Shape (periods, samples, columns), each about its mean."""
    periods = window.cut(signal).reshape(window.periods, window.period, -1)
    return np.asarray(periods - periods.mean(axis=1, keepdims=True))


def _drifts(record: Record, window: Window, loop: NominalLoop) -> list[list[FloatArray]]:
    """Derivatives of a period of y by the nominal parameters, a list of each kind, such as all K_i; none where the
    nominal loop is unstable."""
    if loop.gain_factor is None:
        return []
    kinds: dict[str, list[FloatArray]] = {}
    slopes = loop.model.sensitivity(record, range(len(loop.model.names)))[1]
    for k, name in enumerate(loop.model.names):
        own = _periods(window, slopes[:, : record.y.shape[1], k]).mean(axis=0)
        kinds.setdefault(name.partition(".")[0], []).append(own / max(float(np.linalg.norm(own)), 1e-300))
    return list(kinds.values())


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


def _ramp(at: FloatArray, shift: FloatArray, weight: FloatArray) -> float:
    """The power that a shift explains that grows steadily over time."""
    middle = at - np.average(at, weights=weight)
    own = shift - np.average(shift, weights=weight)
    return float(np.sum(weight * middle * own)) ** 2 / float(np.sum(weight * middle**2))


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
