"""Does y keep in step with a periodic excitation? A clock that runs off, and samples that y alone lost.

y is held against its own mean period x: ``y(t) - x(t) = s(t) dx/dt``. A shift s that grows steadily is another clock;
one that jumps by whole samples, and stays, is samples lost or repeated, which is sought in short stretches.

A parameter that drifts changes y steadily, too, by ``t dx/dtheta``, in which feedback hides some of dx/dt: the less of
a force error gets through, the lower the frequency. So a clock is reported only where it leaves little of what changes
steadily, and less than the drift of any kind of parameter does. Lines count by the noise that stands on them: what
rings at a pole, or wanders, changes from period to period as no white noise of its power does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

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
clocks of 30 to 1000 ppm left up to 0.09 (12 records of `tests/checking/test_instants.py`), a K_i that drifts by 2 to
30 % 0.41 and more (30)."""
BETTER = 2.0
"""Power that the best drift of a parameter must leave over that which a clock leaves: where feedback makes them alike,
no clock is reported. In the same records it was 2.6 and more for clocks, and 0.9 and less for drifts."""
LEAST_CLOCK = 2e-6
"""Difference of two clocks that is reported; that of two quartzes is 1e-5 and more."""
NEIGHBOURS = 5
"""Lines over which the power of noise is averaged, of which a resonance has so many or more."""
ROUNDING = 1e-12
"""Part of the largest line that is taken for noise where there is none."""
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
            own = Change.of(_periods(window, record.y[:, [axis]]), in_noise=False)
            drifts = [[pattern[:, [axis]] for pattern in kind] for kind in _drifts(record, window, loop)]
            if all(own.times * (own.power - own.left(kind)[0]) < by_jump for kind in drifts):
                jumps.append(Jump(axis, window.first + place * length, round(jump)))
    clock = _clock(record, window, loop) if sure_ramps and powers[0] >= powers[1] else None
    return list(jumps) if clock is None else [clock]


@dataclass(frozen=True)
class Change:
    """What changes steadily from period to period, on its lines.

    Attributes
    ----------
    usual : ndarray, shape (samples, columns)
        The mean period.
    each : ndarray, shape (numbers,)
        What a period has more than the one before, over `level`.
    level : ndarray, shape (lines, columns)
        Of the noise in it, as what changes otherwise shows it; of one size where all lines are to count alike.
    times : float
        Power of such a change over all periods, over that of one.
    noise : float
        Power that noise has in `each`; 0 where two periods do not show it.
    """

    usual: FloatArray
    each: FloatArray
    level: FloatArray
    times: float
    noise: float

    @classmethod
    def of(cls, periods: FloatArray, *, in_noise: bool) -> Change:
        """By least squares; where it stands out from noise of any colour, or all lines alike."""
        at, usual = _counted(periods), periods.mean(axis=0)
        times = float(at @ at)
        each = np.tensordot(at, periods, 1) / times
        rest = np.fft.rfft(periods - usual - at[:, None, None] * each, axis=1)
        power = np.sum(np.abs(rest) ** 2, axis=0) / max(1, len(periods) - 2) / times
        level = np.full_like(power, np.sqrt(0.5 * len(usual)))
        if in_noise:
            least = ROUNDING * float(np.abs(np.fft.rfft(usual, axis=0)).max(initial=1e-300))
            level = np.maximum(np.sqrt(0.5 * uniform_filter1d(power, NEIGHBOURS, axis=0, mode="nearest")), least)
        return cls(usual, _over(level, each), level, times, float(np.sum(power / level**2)))

    @property
    def power(self) -> float:
        """Of `each`."""
        return float(self.each @ self.each)

    def left(self, patterns: list[FloatArray]) -> tuple[float, FloatArray]:
        """Power that patterns leave of it, each with the size that leaves least, and these sizes."""
        columns = np.stack([_over(self.level, pattern) for pattern in patterns], axis=1)
        sizes = np.linalg.lstsq(columns, self.each, rcond=None)[0]
        return float(np.sum((self.each - columns @ sizes) ** 2)), np.asarray(sizes)


def _over(level: FloatArray, period: FloatArray) -> FloatArray:
    """A period on its lines, over their level, as real numbers."""
    lines = (np.fft.rfft(period, axis=0) / level).ravel()
    return np.concatenate([lines.real, lines.imag])


def _clock(record: Record, window: Window, loop: NominalLoop) -> Clock | None:
    """The clock of y, where it explains what changes steadily, and no parameter does.

    It is sought about the shift that explains most where all lines count alike, which may be of many samples.
    """
    periods = _periods(window, record.y)
    alike = Change.of(periods, in_noise=False)
    _, (about,) = alike.left([_slope(alike.usual)])
    change = Change.of(_moved(periods, -about * _counted(periods)), in_noise=True)
    slope = _slope(change.usual)
    change = replace(change, each=change.each + about * _over(change.level, slope))
    power, noise, (left, (shift,)) = change.power, change.noise, change.left([slope])
    fast = -float(shift) / window.period
    if abs(fast) < LEAST_CLOCK or left - noise > LEFT * (power - noise) or power < BETTER * left:
        return None
    rivals = [change.left(kind)[0] for kind in _drifts(record, window, loop)]
    return Clock(fast) if min(rivals, default=power) > BETTER * left else None


def _periods(window: Window, signal: FloatArray) -> FloatArray:
    """Shape (periods, samples, columns), each about its mean."""
    periods = window.cut(signal).reshape(window.periods, window.period, -1)
    return np.asarray(periods - periods.mean(axis=1, keepdims=True))


def _counted(periods: FloatArray) -> FloatArray:
    """Number of each period, from the middle one on."""
    return np.asarray(np.arange(len(periods)) - 0.5 * (len(periods) - 1))


def _angles(samples: int) -> FloatArray:
    """Of the lines of a period, a sample."""
    return np.asarray(2.0 * np.pi * np.arange(samples // 2 + 1) / samples)


def _slope(period: FloatArray) -> FloatArray:
    """Derivative of a period by time [1/sample]."""
    lines = 1j * _angles(len(period))[:, None] * np.fft.rfft(period, axis=0)
    return np.asarray(np.fft.irfft(lines, n=len(period), axis=0))


def _moved(periods: FloatArray, earlier: FloatArray) -> FloatArray:
    """Periods that come earlier by so many samples, each by its own."""
    samples = periods.shape[1]
    turned = np.exp(1j * np.outer(earlier, _angles(samples)))[:, :, None]
    return np.asarray(np.fft.irfft(turned * np.fft.rfft(periods, axis=1), n=samples, axis=1))


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
    apart = y - np.tile(usual, len(y) // period)
    slope = np.tile(_slope(usual[:, None])[:, 0], len(y) // period)
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
