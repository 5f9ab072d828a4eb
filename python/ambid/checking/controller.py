"""The controller's equation fitted to a record, axis by axis: factors of its gains and of i_e, and when y was read.

    i_c = A' d' (h i_e - exp(-s l) K (y - r)) + what the controller held at the first sample

The amplifier A' and the delay d' may differ from the known ones by two coefficients and a time, so that a slower
amplifier, one of second order, a delay of the loop or a skew of the sampling is not taken for a wrong gain. l is by how
much y was read late.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from ambid.arrays import ComplexArray, FloatArray, stacked
from ambid.checking.equations import commanded
from ambid.checking.lines import HIGHEST_FREQUENCY, Lines
from ambid.checking.nominal import NominalLoop
from ambid.rig import PidController

MOST_HELD = 8
"""States of a controller up to which what they held is fitted."""
TURN = 1e-4
"""Part of a unit of time by which derivatives of the paths are differenced."""
APART = 1e-2
"""Singular value over the largest, of unit columns, below which delay and lag of an amplifier stand for each other and
stay as they are."""
STRONG = 10.0
"""Strength of instruments below which their errors are too small (Staiger and Stock, Econometrica 65 (1997) 557)."""
SURELY = 3.0
"""Standard deviations, of noise and of what is known beforehand together, by which a gain or an instant must be off."""
IN_TIME = 25.0
"""Fall of chi-squared by a delay of i_c that makes it sure."""
DELAYS = (0.0, -0.5, 0.5, 1.0, 1.5)
"""Delays in samples from which the equation is solved before an instant is said to be off: what is held has a kink at
each."""
ALONE = 30.0
"""Power that is missed on a line over the median beside it; noise exceeds it once in 2^30 lines."""
BESIDE = 41
"""Lines that the median is of."""
SPILLED = 3
"""Lines to each side that hold some of a wave, under a Hann window."""
FOLLOWS = 0.1
"""Part of i_c, by rms, up to which an equation holds that is to show when y or i_c was read."""
FEWEST_CLEAR = 30
"""Fewest lines clear of noise that determine when i_c was read."""
CURRENT_LATE = 0.25
"""Part of a sample by which i_c must be off to be reported; less is ranked as an effect."""
KNOWN_INSTANT = 0.02
"""Standard deviation of an instant by what the equation knows nearly, such as the amplifier, part of a sample: up to
0.03 were seen."""


@dataclass(frozen=True)
class ControllerFit:
    """By which factors the controller's equation holds best on each axis.

    Attributes
    ----------
    parts : tuple of str
        ``i_e``, then the gains of a PID, or ``K`` of any other controller.
    scale, std_error : ndarray, shape (axes, parts)
        1 where the record is as the rig says.
    share : ndarray, shape (axes, parts)
        Rms of each part over that of i_c.
    missed : ndarray, shape (axes,)
        Part of i_c, by rms, that is left unexplained.
    """

    parts: tuple[str, ...]
    scale: FloatArray
    std_error: FloatArray
    share: FloatArray
    missed: FloatArray


@dataclass(frozen=True)
class Late:
    """When y was read on each axis, shape (axes,) each [s].

    Attributes
    ----------
    seconds : ndarray
        By how much y was read late against i_e; 0 where it was not.
    current : ndarray
        By how much i_c comes late against i_e; what the controller's and the amplifier's delays leave to explain.
    """

    seconds: FloatArray
    current: FloatArray


def fit_controller(loop: NominalLoop, lines: Lines) -> ControllerFit:
    """Scale i_e and the gains of the controller so that i_c follows, axis by axis; see the head of this file.

    By instrumental variables, so that noise of y that only the recorder has biases nothing (errors in variables).
    Of a record without periods what stands alone on a line, as a hum does that joins i_c, is left out.
    """
    return _fitted(loop, lines, ("i_e", *commanded(loop, lines)), lambda own: own)


def fit_channels(loop: NominalLoop, lines: Lines) -> ControllerFit:
    """Scale i_e and y, with all gains alike, so that i_c follows, beside what motion induces in the coil."""
    return _fitted(loop, lines, ("i_e", "y"), lambda own: own.of_channels)


def _fitted(
    loop: NominalLoop, lines: Lines, names: tuple[str, ...], of_axis: Callable[[_Equation], _Equation]
) -> ControllerFit:
    """What fits best of each axis' equation."""
    if not (lines.whole_periods or lines.are_responses):
        lines = lines.some(~_alone(loop, lines))
    parts = len(names)
    scale, error, share = (np.full((loop.axes, parts), of_none) for of_none in (1.0, np.inf, 0.0))
    missed = np.full(loop.axes, np.nan)
    both = (map(of_axis, _on_lines(loop, own)) for own in (lines, loop.answered(lines)))
    for k, (equation, ideal) in enumerate(zip(*both, strict=True)):
        x, left = equation.solved()
        x, spread = equation.instrumented(x, ideal)
        scale[k], error[k], share[k], missed[k] = x[:parts], spread[:parts], equation.shares, np.sqrt(left)
    return ControllerFit(names, scale, error, share, missed)


def read_late(loop: NominalLoop, lines: Lines) -> Late | None:
    """By how much y was read late against i_e; None where other gains or a moving coil may be what explains i_c.

    One clock for all axes is determined better than that of each; an axis that is not late has 0.
    """
    sample = 1.0 / loop.rig.sample_rate
    both = list(zip(*(_on_lines(loop, own) for own in (lines, loop.answered(lines))), strict=True))
    ends = []
    for delays in (DELAYS[:1], DELAYS):  # each may lead to an end of its own
        starts = [part * sample for part in delays]
        ends = [
            _instants(both, lambda own: replace(own, has_factors=False, has_instant=True), starts),
            _instants(both, lambda own: replace(own, has_instant=True), starts),
            _instants(both, lambda own: replace(own.of_channels, has_instant=True), starts),
        ]
        late = np.all([_surely(*end, KNOWN_INSTANT * sample) for end in ends], axis=0)
        if not late.any():
            return None
    x, errors = (np.stack(own) for own in zip(*ends, strict=True))
    best = np.argmin(errors[..., -1], axis=0)
    x = np.take_along_axis(x, best[None, :, None], axis=0)[0]
    return Late(np.where(late, x[:, -1], 0.0), x[:, -4])


def _surely(x: FloatArray, errors: FloatArray, known: float) -> NDArray[np.bool_]:
    """Axes that are surely late, where an instant is known to some time: by what each shows, or all together."""
    late, error = x[:, -1], errors[:, -1]
    own = is_off(late, error, known)
    weight = error**-2.0
    if not weight.any():
        return own
    mean = float(weight @ late) / weight.sum()
    together = is_off(mean, weight.sum() ** -0.5, known)
    return own | (together & (np.abs(late - mean) < np.abs(late)))


def is_off(by: FloatArray | float, error: FloatArray | float, known: float) -> NDArray[np.bool_]:
    """Whether a value is off by more than noise and what is known of it beforehand allow, a standard deviation each."""
    return np.asarray(np.abs(by) > SURELY * np.hypot(error, known))


def _instants(
    both: Sequence[tuple[_Equation, _Equation]], way: Callable[[_Equation], _Equation], delays: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Unknowns of every axis' equation and their standard errors, from some delays on, instants in seconds."""
    ends = []
    for equation, ideal in (map(way, own) for own in both):
        x, left = min((equation.solved(start / equation.step) for start in delays), key=lambda end: end[1])
        x, errors = equation.instrumented(x, ideal)
        if left > FOLLOWS**2:
            errors = np.full(len(x), np.inf)
        ends.append((x[-4:] * equation.step, errors[-4:] * equation.step))
    return np.array([x for x, _ in ends]), np.array([errors for _, errors in ends])


def current_late(loop: NominalLoop, lines: Lines) -> FloatArray:
    """By how much i_c comes later than the rig's controller and delay bring it, (axes,) [s]; 0 where it does not.

    The amplifier may have any lag, be of second order, and have voltage induced in its coil by motion. An axis whose
    i_c does not follow from that either has 0, as one has that is clear of noise on few lines.
    """
    found = np.zeros(loop.axes)
    for k, equation in _equations(loop, lines).items():
        moved = replace(equation, has_factors=False, induces=True)
        sample = 1.0 / (loop.rig.sample_rate * equation.step)
        end = min((moved.solved(part * sample) for part in (0.0, -1.0)), key=lambda end: end[1])
        if abs(end[0][-4]) > CURRENT_LATE * sample:  # each delay may lead to an end of its own
            end = min((end, *(moved.solved(part * sample) for part in DELAYS)), key=lambda end: end[1])
        x, left = end
        in_time = replace(moved, has_delay=False, has_lag=x[-4] < 0.0).solved()[1]  # a slow amplifier is late, too
        is_sure = (in_time / left - 1.0) * 2 * len(equation.i_c) > IN_TIME
        if left < FOLLOWS**2 and abs(x[-4]) > CURRENT_LATE * sample and is_sure:
            found[k] = x[-4] * equation.step
    return found


def _alone(loop: NominalLoop, lines: Lines) -> NDArray[np.bool_]:
    """Lines next to one that the rig's own equation misses by far more than those around, unless it is excited so."""
    found = np.zeros(len(lines.frequency_hz), dtype=bool)
    for equation in _on_lines(loop, lines):
        missed, driven = (np.abs(own) ** 2 for own in (equation.missed_by_rig, equation.i_e))
        is_driven = driven > ALONE * median_filter(driven, BESIDE, mode="nearest")
        found |= (missed > ALONE * median_filter(missed, BESIDE, mode="nearest")) & ~is_driven
    near = np.abs(lines.index[:, None] - lines.index[found]) <= SPILLED
    return np.asarray(near.any(axis=1))


def _equations(loop: NominalLoop, lines: Lines) -> dict[int, _Equation]:
    """That of every axis that is clear of noise on enough lines, on these; none where no periods show which are.

    Noise of a sensor that is held over its sample passes an analog controller half a sample late.
    """
    clear = np.zeros_like(lines.y, dtype=bool) if lines.clear is None else lines.clear
    axes = np.flatnonzero(np.count_nonzero(clear, axis=0) >= FEWEST_CLEAR)
    return {int(k): _on_lines(loop, lines.some(clear[:, k]))[k] for k in axes}


def _on_lines(loop: NominalLoop, lines: Lines) -> list[_Equation]:
    """That of every axis, on all of some lines."""
    f = lines.frequency_hz
    of_y = -np.stack([*commanded(loop, lines).values()], axis=2)
    held, i_c = _held_by_controller(loop, lines), np.asarray(lines.i_c)
    step = 1.0 / (2.0 * np.pi * HIGHEST_FREQUENCY * loop.rig.sample_rate)

    @lru_cache
    def paths(delay: float, lag: float) -> tuple[ComplexArray, ComplexArray]:
        return loop.paths(f, more_delay=delay * step, more_lag=lag * step)

    return [
        _Equation(
            i_e=lines.i_e[:, k],
            of_y=of_y[:, k],
            motion=2j * np.pi * f * lines.y[:, k] * np.linalg.norm(i_c[:, k]) / np.linalg.norm(f * lines.y[:, k]),
            held=held / np.linalg.norm(held, axis=0),
            i_c=i_c[:, k],
            paths=paths,
            step=step,
            s=np.asarray(2j * np.pi * f * step, np.complex128),
            tau=loop.rig.amplifier.time_constant / step,
        )
        for k in range(loop.axes)
    ]


@dataclass(frozen=True)
class _Equation:
    """The equation of one axis.

    Unknowns are the factors of i_e and of what the gains make of y, that of what motion induces, what was held; then
    delay, lag, the second coefficient of the amplifier, and how late y was read, in units of `step`, the shortest time
    that lines may show.
    """

    i_e: ComplexArray
    of_y: ComplexArray
    motion: ComplexArray
    held: ComplexArray
    i_c: ComplexArray
    paths: Callable[[float, float], tuple[ComplexArray, ComplexArray]]
    step: float
    s: ComplexArray
    tau: float
    has_factors: bool = True
    has_delay: bool = True
    has_lag: bool = True
    has_instant: bool = False
    induces: bool = False

    @property
    def size(self) -> float:
        """Norm of i_c."""
        return float(np.linalg.norm(self.i_c))

    @property
    def of_channels(self) -> _Equation:
        """That with one factor of y, and motion in the coil."""
        return replace(self, of_y=self.of_y.sum(axis=1, keepdims=True), induces=True)

    @property
    def missed_by_rig(self) -> ComplexArray:
        """What i_c is missed by with the rig's own gains, nothing having been held."""
        excited, fed_back = self.paths(0.0, 0.0)
        return excited * self.i_e + fed_back * self.of_y.sum(axis=1) - self.i_c

    @property
    def shares(self) -> FloatArray:
        """Rms of i_e and of what each gain makes of y over that of i_c."""
        excited, fed_back = self.paths(0.0, 0.0)
        parts = np.column_stack([excited * self.i_e, fed_back[:, None] * self.of_y])
        return np.asarray(np.linalg.norm(parts, axis=0) / self.size)

    def solved(self, delay: float = 0.0) -> tuple[FloatArray, float]:
        """Unknowns by least squares, and the square of the part of i_c that is left, from a delay on."""
        first = np.concatenate([np.ones(1 + self.of_y.shape[1]), np.zeros(1 + self.held.shape[1] + 4)])
        first[-4] = delay
        free = self._free

        def whole(x: FloatArray) -> FloatArray:
            out = first.copy()
            out[free] = x
            return out

        linear = free[free < len(first) - 4]
        still = self._jacobian(first)[:, linear]
        if len(still) <= len(free):  # so few lines determine nothing
            return first, float(np.sum(self._residual(first) ** 2))
        first[linear] -= np.linalg.lstsq(still, self._residual(first), rcond=None)[0]
        end = least_squares(
            lambda x: self._residual(whole(x)),
            first[free],
            lambda x: self._jacobian(whole(x))[:, free],
            method="lm",
            x_scale="jac",
            ftol=1e-9,
            xtol=1e-6,
        )
        return whole(end.x), 2.0 * float(end.cost)

    def instrumented(self, x: FloatArray, ideal: _Equation) -> tuple[FloatArray, FloatArray]:
        """Unknowns from those of least squares on, and their standard errors, by instruments without noise.

        Noise that only a recorder has in y biases least squares, and nothing that is at right angles to what the
        excitation makes of y. The errors are right whatever the power of each line's noise (Soederstroem and Stoica,
        System Identification, 1989, chapter 8), on few lines too (MacKinnon and White, J. Econometrics 29 (1985) 305).
        """
        free, x, errors = self._free, x.copy(), np.zeros(len(x))
        if 2 * len(self.i_c) <= len(free):
            return x, np.full(len(x), np.inf)
        ideal = replace(self, of_y=ideal.of_y, motion=ideal.motion)
        for _ in range(20):  # Newton's method; the last step may be a standard error: whole samples of delay are kinks
            left, columns, instruments = (own(x) for own in (self._residual, self._jacobian, ideal._jacobian))
            columns, instruments = columns[:, free], instruments[:, free]
            size, own = (np.maximum(np.linalg.norm(table, axis=0), 1e-300) for table in (columns, instruments))
            columns, instruments = columns / size, instruments / own
            inverse = np.linalg.pinv(instruments.T @ columns, rcond=APART) / size[:, None]
            step = inverse @ (instruments.T @ left)
            x[free] -= step
            if (largest := np.abs(step).max()) > 1.0 / TURN:  # it diverges
                return x, np.full(len(x), np.inf)
            if largest < TURN**2:
                break
        own_share = np.einsum("nj,jn->n", columns * size, inverse @ instruments.T)  # of a number in its own prediction
        left /= np.maximum(1.0 - own_share, 1.0 / len(left))
        errors[free] = np.linalg.norm(inverse @ (instruments * left[:, None]).T, axis=1)
        of_y, last = range(1, 2 + self.of_y.shape[1]), len(x) - 1
        sought = np.isin(free, [0, *of_y, last])
        ended = np.abs(step[sought]) <= errors[free][sought] + TURN**2
        if not ended.all() or _strength(columns, instruments, np.isin(free, [*of_y, last])) < STRONG:
            errors = np.full(len(x), np.inf)
        return x, errors

    @property
    def _free(self) -> NDArray[np.intp]:
        """Which unknowns are sought."""
        gains, held = self.of_y.shape[1], self.held.shape[1]
        last = [self.has_delay, self.has_lag, self.has_lag, self.has_instant]
        return np.flatnonzero([*[self.has_factors] * (1 + gains), self.induces, *[True] * held, *last])

    def _lag(self, more: float) -> float:
        """That of the amplifier, which is none below zero where it is known to have one."""
        return max(0.0, self.tau + more) if self.tau > 0.0 else more

    def _residual(self, x: FloatArray) -> FloatArray:
        """What i_c is missed by, relative to it; real parts, then imaginary ones."""
        return stacked(sum(self._parts(x, self.paths(x[-4], x[-3]))) - self.i_c) / self.size

    def _parts(self, x: FloatArray, paths: tuple[ComplexArray, ComplexArray]) -> tuple[ComplexArray, ...]:
        """i_c by i_e, by y, and by what was held."""
        gains = self.of_y.shape[1]
        lag, second, late = x[-3:]
        more = 1.0 / (1.0 + second * self.s**2 / (1.0 + self.s * self._lag(lag)))
        seen = np.exp(-self.s * late)
        by_y = self.of_y @ x[1 : 1 + gains] + self.motion * x[1 + gains]
        return more * paths[0] * self.i_e * x[0], more * paths[1] * seen * by_y, self.held @ x[2 + gains : -4]

    def _jacobian(self, x: FloatArray) -> FloatArray:
        """Derivatives of the residual; by delay and lag they are differences of the paths."""
        paths, (lag, second, late) = self.paths(x[-4], x[-3]), x[-3:]
        by_i_e, by_y, _ = self._parts(x, paths)
        pole = 1.0 + self.s * self._lag(lag)
        more, seen = 1.0 / (1.0 + second * self.s**2 / pole), np.exp(-self.s * late)
        columns = [more * paths[0] * self.i_e]
        columns += [more * paths[1] * seen * own for own in (*self.of_y.T, self.motion)]
        columns += list(self.held.T)
        gains = self.of_y.shape[1]
        y = self.of_y @ x[1 : 1 + gains] + self.motion * x[1 + gains]
        for turn in ((TURN, 0.0), (0.0, TURN)):
            up, down = (self.paths(x[-4] + sign * turn[0], x[-3] + sign * turn[1]) for sign in (1.0, -1.0))
            of_i_e, of_y = ((a - b) / (2.0 * TURN) for a, b in zip(up, down, strict=True))
            columns.append(more * (of_i_e * self.i_e * x[0] + of_y * seen * y))
        moved = by_i_e + by_y
        columns[-1] += more * second * self.s**3 / pole**2 * moved
        columns.append(-more * self.s**2 / pole * moved)
        columns.append(-self.s * by_y)
        return stacked(np.column_stack(columns)) / self.size


def _strength(columns: FloatArray, instruments: FloatArray, noisy: NDArray[np.bool_]) -> float:
    """Least F of any mixture of noisy columns on their instruments (Cragg and Donald, Econ. Theory 9 (1993) 222)."""
    known = columns[:, ~noisy]
    own, by = (table[:, noisy] - known @ np.linalg.lstsq(known, table[:, noisy])[0] for table in (columns, instruments))
    seen = by @ np.linalg.lstsq(by, own)[0]
    left = own - seen
    scatter = left.T @ left / max(1, len(columns) - columns.shape[1])
    return float(np.linalg.eigvals(np.linalg.pinv(scatter) @ (seen.T @ seen)).real.min() / noisy.sum())


def _held_by_controller(loop: NominalLoop, lines: Lines) -> ComplexArray:
    """What a unit in each state of one axis' controller leaves on lines of whole periods, (lines, states).

    A controller of many states is taken to forget them soon; beside a window of the whole record nothing is left.
    """
    own, rate = loop.rig.controller, loop.rig.sample_rate
    a, *_ = own.state_space(1 if isinstance(own, PidController) else loop.axes, rate)
    if not lines.whole_periods or not 0 < len(a) <= MOST_HELD:
        return np.zeros((len(lines.frequency_hz), 0), dtype=complex)
    poles = np.linalg.eigvals(a)
    poles = poles ** (own.rate(rate) / rate) if own.is_digital else np.exp(poles / rate)
    w = np.exp(2j * np.pi * lines.frequency_hz / rate)[:, None]
    left = loop.paths(lines.frequency_hz)[1][:, None] * w / (w - poles[poles.imag >= 0.0])
    turned = 1j * left[:, poles[poles.imag >= 0.0].imag > 0.0]
    return np.asarray(np.hstack([left, turned]))
