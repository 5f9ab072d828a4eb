"""Noise where it arises: what the controller hears goes round the loop, what only the recorder has does not.

The lines of a record that are not excited have the covariance

    S(l) = G(l) A(l) G(l)^H + B(l),

G the way from noise of what the controller reads to y and i_c, A and B diagonal, the logarithm of each power a smooth
curve over the logarithm of frequency: cubic splines, whose coefficients make the lines likeliest (Whittle), found by
Fisher's scoring. With h_c the columns of H = [G, 1] and P_c the powers, the score of log P_c on a line z is
P_c (|h_c^H S^-1 z|^2 - h_c^H S^-1 h_c), the information of two of them P_c P_d |h_c^H S^-1 h_d|^2. Second differences
of the coefficients cost a little, and so does the way from the start: of a power far below what stands beside it the
lines show nothing.

A line that noise makes once in ten thousand times or less counts for less, q = z^H S^-1 z being replaced by
c (1 + log(q / c)) beyond c: what a model misses beside a tone is no noise.

Numbers q that were fitted to n lines of p channels make S too small: lines that were not fitted to have, in the mean,
z^H S^-1 z = p + h(l), where h is the information on a line times the covariance of the coefficients, and sums to q over
those that were (as Akaike's criterion counts them; of one full matrix q = p^2, and 1 + q/(n p) is Hotelling's factor).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import ModelError
from ambid.noise.chance import UNUSUAL

FITTED = 1000
"""Lines that curves are fitted to."""
LOWEST = 12
"""Unexcited lines up to the frequency below which knots no longer lie evenly over its logarithm, one an octave."""
ROUGHLY = 400
"""Lines that show roughly where noise arises."""
DISTINCT = 0.7
"""Standard deviation of the log of the ratio of two powers below which they are distinguished: a factor of two."""
STIFFNESS, HOLD = 0.3, 1e-3
"""What a second difference of coefficients costs, and the square of the way from the start."""
STEPS, LARGEST, CLOSE = 25, 3.0, 0.1
"""Of the scoring: steps at the most, the largest change of a logarithm in one, and the rise of the logarithm of the
likelihood that is not worth another."""
QUIETER = 4.0
"""Logarithm of a power over another that one start of the scoring takes for all of it."""


class Curves(NamedTuple):
    """Cubic splines over log(frequency + corner)."""

    corner: float
    low: float
    step: float
    splines: int

    @classmethod
    def over(cls, angle: FloatArray) -> Curves:
        """For noise at frequencies, in their order [rad/sample]."""
        corner = float(angle[min(LOWEST, len(angle) - 1)])
        low, high = np.log(angle[[0, -1]] + corner)
        pieces = max(1, round((high - low) / np.log(2.0)))
        return cls(corner, float(low), float(high - low) / pieces, pieces + 3)

    def at(self, angle: FloatArray) -> tuple[NDArray[np.uintp], FloatArray]:
        """The first of the four splines at each frequency, and their values, shape (frequencies, 4)."""
        pieces = self.splines - 3
        place = np.clip((np.log(angle + self.corner) - self.low) / self.step, 0.0, pieces)
        first = np.minimum(place.astype(np.intp), pieces - 1)
        t = place - first
        values = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
        return first.astype(np.uintp), np.stack(values, axis=1) / 6.0

    def matrix(self, angle: FloatArray) -> FloatArray:
        """Every spline at frequencies, shape (frequencies, count)."""
        first, values = self.at(angle)
        whole = np.zeros((len(angle), self.splines))
        np.put_along_axis(whole, first[:, None].astype(np.intp) + np.arange(4), values, axis=1)
        return whole


class SplitNoise:
    """Powers of noise that is heard and of noise that is not, over frequency.

    Parameters
    ----------
    lines : ndarray, shape (lines, p)
        Not excited, in order of frequency.
    way : ndarray, shape (lines, p, heard)
        From noise of what the controller reads to them.
    angle : ndarray, shape (lines,)
        Frequency of each [rad/sample].
    most : int
        Lines that the curves are fitted to, at the most.

    Attributes
    ----------
    heard : int
        Channels whose noise may be heard, the first ones.
    numbers : float
        That the fit has taken.

    Raises
    ------
    ModelError
        If there is no noise on some channel.
    """

    def __init__(self, lines: ComplexArray, way: ComplexArray, angle: FloatArray, most: int = FITTED) -> None:
        self.heard, self.curves = way.shape[2], Curves.over(angle)
        few = _thinned(len(lines), most)
        self._lines, self._share = len(lines), len(few) / len(lines)
        scale = np.sqrt(np.mean(np.abs(lines[few]) ** 2, axis=0))
        scale[scale == 0.0] = 1.0
        self._scale = scale
        bend = np.diff(np.eye(self.curves.splines), 2, axis=0)
        self._stiff = STIFFNESS * bend.T @ bend
        sources = self._sources(way[few], angle[few])
        z = np.ascontiguousarray(lines[few] / self._scale)
        starts = self._starts(way[few], lines[few], angle[few])
        usual = float(gammainccinv(lines.shape[1], UNUSUAL))
        start = max(starts, key=lambda own: sources.likely(z, own, usual)[0])
        self._fit(sources, z, start, usual)

    def whitening(self, way: ComplexArray, angle: FloatArray) -> ComplexArray:
        """Inverse of the Cholesky factor of S at frequencies, shape (frequencies, p, p)."""
        return np.asarray(self._sources(way, angle).whitening(self._coefficients) / self._scale)

    def fitted(self, way: ComplexArray, angle: FloatArray) -> FloatArray:
        """Numbers that the fit has taken at each frequency: h of the formulas above."""
        return self._sources(way, angle).fitted(self._coefficients, self._variance)

    def powers(self, angle: FloatArray) -> FloatArray:
        """Of noise that is heard, then of noise that is not, shape (frequencies, heard + p)."""
        return np.asarray(np.exp(self.curves.matrix(angle) @ self._coefficients.T) * self._source_scale**2)

    def separable(self, way: ComplexArray, angle: FloatArray) -> NDArray[np.bool_]:
        """Where noise of which half is heard would be known to be so, shape (frequencies, heard).

        By the information that as many lines as were fitted to would have on the ratio of the halves. Where the loop
        does nothing to what is heard, no line shows it.
        """
        few, channels = _thinned(len(angle), ROUGHLY), range(self.heard)
        at, own = angle[few], way[few]
        basis, powers = self.curves.matrix(at), self.powers(at)
        shown = np.abs(own[:, channels, channels]) ** 2
        half = 0.5 * (powers[:, : self.heard] * shown + powers[:, self.heard : 2 * self.heard])
        powers[:, : self.heard], powers[:, self.heard : 2 * self.heard] = half / np.maximum(shown, 1e-300), half
        level = np.log(powers / self._source_scale**2)
        smooth = np.linalg.solve(basis.T @ basis + 1e-6 * np.eye(self.curves.splines), basis.T @ level)
        nothing = np.zeros((len(few), way.shape[1]), dtype=complex)
        try:
            *_, information = self._sources(own, at).likely(nothing, np.ascontiguousarray(smooth.T), np.inf)
        except ModelError:  # a loop at the edge of stability makes more of what is heard than numbers hold
            return np.zeros((len(angle), self.heard), dtype=bool)
        variance = np.linalg.inv(information * (self._lines / len(few)) + self._cost(way.shape[1] + self.heard))
        blocks = variance.reshape(len(smooth.T), self.curves.splines, -1, self.curves.splines).transpose(0, 2, 1, 3)
        every, found = self.curves.matrix(angle), np.zeros((len(angle), self.heard), dtype=bool)
        for c in channels:
            r = self.heard + c
            ratio = blocks[c, c] + blocks[r, r] - blocks[c, r] - blocks[r, c]
            found[:, c] = np.einsum("lj,jk,lk->l", every, ratio, every) < DISTINCT**2
        return found

    @property
    def _source_scale(self) -> FloatArray:
        return np.asarray(np.concatenate([self._scale[: self.heard], self._scale]), dtype=float)

    def _cost(self, sources: int) -> FloatArray:
        return np.asarray(np.kron(np.eye(sources), self._stiff + HOLD * np.eye(self.curves.splines)), dtype=float)

    def _sources(self, way: ComplexArray, angle: FloatArray) -> _core.Sources:
        """Channels in units of their rms, noises in units of those of the channels."""
        count, p, heard = way.shape
        ways = np.zeros((count, p, heard + p), dtype=complex)
        ways[:, :, :heard] = way * (self._scale[:heard] / self._scale[:, None])
        ways[:, range(p), range(heard, heard + p)] = 1.0
        return _core.Sources(ways, *self.curves.at(angle), self.curves.splines)

    def _starts(self, way: ComplexArray, lines: ComplexArray, angle: FloatArray) -> list[FloatArray]:
        """Coefficients with all noise heard, none, and half of it."""
        heard, basis = self.heard, self.curves.matrix(angle)
        behind = np.linalg.solve(way[:, :heard], lines[:, :heard, None])[:, :, 0] / self._scale[:heard]
        power = np.abs(np.concatenate([behind, lines / self._scale], axis=1)) ** 2
        # the mean logarithm of the power of a line of noise, whose mean is one, is minus Euler's constant
        level = np.log(np.maximum(power, 1e-12 * power.mean(axis=0) + 1e-300)) + np.euler_gamma
        level = np.linalg.solve(
            basis.T @ basis + 3.0 * self._stiff + 1e-6 * np.eye(self.curves.splines), basis.T @ level
        )
        first, last = np.arange(level.shape[1]) < heard, np.zeros(level.shape[1], dtype=bool)
        last[heard : 2 * heard] = True
        half = np.log(2.0) * (first | last)
        return [np.ascontiguousarray((level - quieter).T) for quieter in (QUIETER * last, QUIETER * first, half)]

    def _fit(self, sources: _core.Sources, z: ComplexArray, start: FloatArray, usual: float) -> None:
        here = start
        likelihood, score, information = sources.likely(z, here, usual)
        cost = self._cost(len(start))
        bent = float(np.sum((here @ self._stiff) * here)) / 2.0
        best, damping = likelihood - bent, 1e-3
        for _ in range(STEPS):
            pull = score - here @ self._stiff - HOLD * (here - start)
            system = information + cost
            system[np.diag_indices_from(system)] *= 1.0 + damping
            step = np.linalg.solve(system, pull.ravel()).reshape(here.shape)
            step *= min(1.0, LARGEST / max(float(np.abs(step).max()), 1e-300))
            tried = here + step
            try:
                found = sources.likely(z, tried, usual)
                bent = float(np.sum((tried @ self._stiff) * tried) + HOLD * np.sum((tried - start) ** 2))
                value = found[0] - 0.5 * bent
            except ModelError:
                value = -np.inf
            if value > best:
                rise, best, here = value - best, value, tried
                _, score, information = found
                damping = max(damping / 5.0, 1e-6)
                if rise < CLOSE:
                    break
            else:
                damping = max(10.0 * damping, 1e-2)
                if damping > 1e4:  # damping of the scoring beyond which there is no way up
                    break
        self._coefficients = here
        self._variance = np.asarray(self._share * np.linalg.inv(information + cost), dtype=float)
        self.numbers = float(np.sum(self._variance * information)) / self._share


def _thinned(count: int, most: int) -> NDArray[np.intp]:
    """At most so many lines: all of the lowest, then every so many."""
    if count <= most:
        return np.arange(count)
    low = most // 3
    return np.concatenate([np.arange(low), np.linspace(low, count - 1, most - low).astype(np.intp)])
