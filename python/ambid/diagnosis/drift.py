"""Do parameters change during a record? What does not repeat, held against the patterns of the parameters.

If K_i of an axis changes as m(t), the response changes by about m(t) psi(t), psi being its derivative by K_i. On the
excited lines l = M k of the spectrum stands psi; what m(t) holds at d cycles per record moves it to the lines M k + d,
and, taken back through the loop, changes it little on the way. The residual there, whitened, is projected on psi; noise
alone leaves a chi-squared of two degrees. A steady drift by h from begin to end holds i h / (2 pi d) at each d: all
of them together have one number. What warms one magnet, or changes its bias, does so to all: K_i of all axes, and K_s
of all, change in the same proportion more likely than each alone.

What changes is louder than noise on the very lines that give the noise, and hides behind itself, the more the larger
it is. So what is suspected is taken out of them by least squares, and all is whitened by what is left, and tried again.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.special import chdtri

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.findings import Where
from ambid.model import Model
from ambid.noise import Comparison, Criterion
from ambid.noise.chance import UNUSUAL, independent_tests, log_chance, log_mean_odds_against
from ambid.noise.lines import RecordLines, as_lines
from ambid.noise.tones import Between
from ambid.noise.whitener import Spectrum, between_lines

FASTEST = 24
"""Cycles per record up to which changes are looked for."""
SUSPECTED = 0.01
"""Chance that noise alone is taken for a change of some parameter, below which a change is taken out of the
lines that give the noise."""
KINDS = 2
"""Of change that are looked for: to and fro, and steadily."""
ALIKE = 1e-9
"""Part of the largest eigenvalue below which patterns are the same one: that of all axes is the sum of theirs."""
SHARE, EVENED = 0.05, 30
"""Of a pattern's energy on any one line, by so many roundings off: a peak of noise that the spectrum does not follow
stands on a line or two, a change on all of them."""


@dataclass(frozen=True)
class Change:
    """A parameter that changes while the record is taken.

    Attributes
    ----------
    record, parameter : str
        The parameter whose pattern the change fits best; ``K_i`` or ``K_s`` where it is that of all axes.
    frequency_hz : float
        Of the change; 0 for a steady drift.
    cycles : int
        In the part of the record that counts; none for a drift.
    relative : float
        Amplitude of the change, or drift from begin to end, over the parameter's value.
    power : float
        In units of noise, on average `degrees` where nothing changes.
    degrees : int
    trials : float
        How many independent patterns and shifts it is the largest of.
    """

    record: str
    parameter: str
    frequency_hz: float
    cycles: int
    relative: float
    power: float
    degrees: int
    trials: float

    @property
    def criterion(self) -> Criterion:
        """Of a model beside which it stays."""
        where = Where(record=self.record, key=self.parameter)
        power = self.power / self.degrees
        return Criterion("drift", power, self.degrees, trials=self.trials, level=UNUSUAL, where=where)

    @property
    def odds(self) -> float:
        """Log of the odds for it against noise alone."""
        return log_mean_odds_against(self._log_p)

    @property
    def _log_p(self) -> float:
        return min(0.0, float(np.log(self.trials)) + log_chance(self.power, self.degrees))

    @property
    def values(self) -> dict[str, Any]:
        """What is said of it."""
        drift, change = (self.relative, None) if not self.cycles else (None, self.relative)
        return {"parameter": self.parameter, "drift": drift, "change": change, "frequency_hz": self.frequency_hz}


def largest_change(changes: Iterable[Change]) -> Change | None:
    """The one of some that stands out most, if noise alone hardly brings it."""
    beyond_chance = [own for own in changes if own.criterion.fails]
    return min(beyond_chance, key=lambda own: own._log_p, default=None)


def changes_of(comparison: Comparison) -> list[Change]:
    """Of the parameters of the base model the change in each record that stands out most, be it no more than noise.

    The noise is that of the residual of the comparison's own model.
    """
    model = comparison.model
    found: list[Change] = []
    for part in comparison.noise.in_time:
        record, window = part.record, part.window.settled
        shifts = np.arange(1, min(FASTEST, window.periods * (len(window.excited) // 2)) + 1)
        # a line half-way between two excited ones is on either side of one, and cannot distinguish them
        shifts = shifts[2 * shifts % window.periods != 0]
        if not len(shifts):
            continue
        names, patterns = _patterns(part, model)
        if not names:
            continue
        sidebands = _Sidebands(part, patterns, shifts)
        amplitudes, powers, drifts, drift_powers = sidebands.tested()
        k, j = (int(place) for place in np.unravel_index(np.argmax(powers), powers.shape))
        d, per_line = int(shifts[k]), record.sample_rate / window.samples
        relative, tests = 2.0 * float(np.abs(amplitudes[k, j])), sidebands.tests
        swing = Change(record.name, names[j], d * per_line, d, relative, float(powers[k, j]), 2, KINDS * tests)
        tests, j = tests / len(shifts), int(np.argmax(drift_powers))
        drift = Change(record.name, names[j], 0.0, 0, float(drifts[j]), float(drift_powers[j]), 1, KINDS * tests)
        found.append(min(swing, drift, key=lambda own: own._log_p))
    return found


def _patterns(part: RecordLines, model: Model) -> tuple[list[str], ComplexArray]:
    """Whitened changes of the excited lines by relative changes, by name, shape (lines, p, names).

    Of each parameter that acts, not those of other bias currents, and of all of a kind together.
    """
    count, p = len(part.window.excited), len(part.record.channels)
    names, found = [], []
    for kind in ("K_i", "K_s"):
        own = [k for k, name in enumerate(model.names) if name.startswith(kind)]
        patterns = as_lines(part.slopes(part.at(model), own), p)[:count] * model.theta[own]
        acting = np.flatnonzero(np.abs(patterns).max(axis=(0, 1)) > 0.0)
        names += [model.names[own[k]] for k in acting]
        found.append(patterns[..., acting])
        if len(acting) > 1:
            names.append(kind)
            found.append(patterns.sum(axis=2, keepdims=True))
    return names, np.concatenate(found, axis=2)


class _Sidebands:
    """The unexcited lines of a record, and the patterns that a change would move to them.

    Parameters
    ----------
    part : RecordLines
    patterns : ndarray, shape (lines, p, patterns)
        Whitened, on the excited lines.
    shifts : ndarray of int
        Of the lines, to either side.

    Attributes
    ----------
    tests : float
        How many independent ones the patterns at all shifts are.
    """

    def __init__(self, part: RecordLines, patterns: ComplexArray, shifts: NDArray[np.intp]) -> None:
        self.window, self.shifts = part.window.settled, shifts
        between = Between.of(part, self.window.between(self.window.periods), part.tones)
        # the lines have been taken back through the loop, each at its own frequency; what is left of S is smooth
        self.lines, self.inner = between.lines, between.inner
        self.patterns = np.linalg.solve(self.inner, patterns)
        energy = level = np.sum(np.abs(patterns) ** 2, axis=1)
        for _ in range(EVENED):
            level = SHARE * np.minimum(energy, level).sum(axis=0)
        self.weights = np.sqrt(level / np.maximum(energy, level))
        stacked = patterns.reshape(-1, patterns.shape[2])
        unit = stacked / np.linalg.norm(stacked, axis=0)
        self.tests = len(shifts) * independent_tests(unit.conj().T @ unit, unit.shape[1])
        lines, last = np.arange(len(self.lines)), len(self.inner) - 1
        self.nearest = np.clip(np.round(lines / self.window.periods).astype(np.intp) - self.window.lowest, 0, last)

    def tested(self) -> tuple[ComplexArray, FloatArray, FloatArray, FloatArray]:
        """Amplitude of each pattern at each shift, and its power in units of noise, both (shifts, patterns).

        Then the steady drift of each from begin to end, and its power, both (patterns,).
        """
        seen, enough = np.zeros(len(self.shifts), dtype=bool), chdtri(2, SUSPECTED / self.tests)
        left, inner = self.lines, self.inner
        while True:
            grams, projections, variances = self._projected(inner, self._louder(left, inner))
            powers = np.abs(projections) ** 2 / variances
            # what is alike at all shifts is noise that the motion modulates, as a limit does
            alike = np.maximum(1.0, np.median(powers, axis=0) / chdtri(2, 0.5))
            powers /= alike
            new = (powers.max(axis=1) > enough) & ~seen
            if not new.any():
                energies = np.einsum("sjj->sj", grams).real
                return projections / energies, powers, *self._drifts(energies, projections, alike * variances)
            seen |= new
            amplitudes = np.linalg.pinv(grams, rcond=ALIKE, hermitian=True) @ projections[..., None]
            left = self._without(amplitudes[..., 0] * seen[:, None])
            inner = self._whitening(left, int(seen.sum()))

    def _drifts(
        self, energies: FloatArray, projections: ComplexArray, variances: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Of the steady drift of each pattern the height from begin to end, and its power, both (patterns,)."""
        ramp = 1j / (2.0 * np.pi * self.shifts[:, None])
        fitting = np.sum((ramp.conj() * projections).real, axis=0)
        squares = np.abs(ramp) ** 2
        return fitting / np.sum(squares * energies, axis=0), fitting**2 / np.sum(squares * variances, axis=0)

    def _projected(self, inner: ComplexArray, louder: FloatArray) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """Inner products of the patterns at each shift with each other, shape (shifts, q, q), and with the lines, shape
        (shifts, q), and half the variance of these.

        The lines may be louder than their noise; a change of real m(t) has conjugate amplitudes on the two sides.
        """
        q, count = self.patterns.shape[2], len(self.patterns)
        grams = np.zeros((len(self.shifts), q, q), dtype=complex)
        projections = np.zeros((len(self.shifts), q), dtype=complex)
        variances = np.zeros((len(self.shifts), q))
        white = _core.through(inner[self.nearest], self.lines) / np.sqrt(louder)[:, None]
        for sign in (1, -1):
            before = None
            for n, d in enumerate(self.shifts):
                offset = int(np.round(d / self.window.periods)) * sign
                own = slice(max(-offset, 0), count - max(offset, 0))
                if offset != before:
                    moved = inner[own.start + offset : own.stop + offset] @ self.patterns[own]
                    weighed = (moved * self.weights[own, None]).reshape(-1, q)
                    across, before = weighed.conj().T, offset
                    gram, variance = across @ moved.reshape(-1, q), np.sum(np.abs(weighed) ** 2, axis=0)
                projection = across @ white[self._places(own, sign * d)].ravel()
                grams[n] += gram if sign > 0 else gram.conj()
                projections[n] += projection if sign > 0 else projection.conj()
                variances[n] += variance
        return grams, projections, variances

    def _without(self, amplitudes: ComplexArray) -> ComplexArray:
        """The lines without so much of each pattern at each shift, shape (shifts, q)."""
        left, count = self.lines.copy(), len(self.patterns)
        for d, own in zip(self.shifts, amplitudes, strict=True):
            for side, amplitude in ((d, own), (-d, own.conj())):
                offset = int(np.round(side / self.window.periods))
                here = slice(max(-offset, 0), count - max(offset, 0))
                left[self._places(here, side)] -= self.patterns[here] @ amplitude
        return left

    def _places(self, patterns: slice, side: int) -> NDArray[np.intp]:
        """The lines to which a shift moves patterns."""
        return np.asarray(self.window.excited[patterns] + side)

    def _whitening(self, left: ComplexArray, shifts: int) -> ComplexArray:
        """What whitens lines that hold no more than noise, by themselves; patterns were taken out of them."""
        index, periods = self.window.between(self.window.periods), self.window.periods
        covariance, spread = between_lines(left[index], index / periods, self.window.excited / periods)
        taken = self.patterns.shape[2] * shifts / (len(index) * left.shape[1])
        flat = np.tile(np.eye(left.shape[1], dtype=complex), (len(self.inner), 1, 1))
        return Spectrum.of(covariance / max(1.0 - taken, 0.5), flat, spread).inner

    def _louder(self, left: ComplexArray, inner: ComplexArray) -> FloatArray:
        """Power of the lines around each, over that of their noise: peaks that the spectrum does not follow."""
        power = np.mean(np.abs(_core.through(inner[self.nearest], left)) ** 2, axis=1) / 2.0
        known, around = (power > 0.0).astype(float), np.ones(2 * self.window.periods + 1)
        around[self.window.periods] = 0.0
        counted = np.maximum(convolve1d(known, around, mode="constant"), 1.0)
        return np.maximum(1.0, convolve1d(power, around, mode="constant") / counted)
