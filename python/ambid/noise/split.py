"""Noise where it arises: what the controller hears goes round the loop, what only the recorder has does not.

The lines of a record that are not excited have the covariance

    S(l) = G(l) A(l) G(l)^H + B(l),

G the way from noise of what the controller reads to y and i_c, A and B diagonal, the logarithm of each power a smooth
curve over the logarithm of frequency: cubic splines, whose coefficients make the lines likeliest (Whittle), found by
Fisher's scoring. With h_c the columns of H = [G, 1] and P_c the powers, the score of log P_c on a line is
P_c (|h_c^H S^-1 z|^2 - h_c^H S^-1 h_c), the information of two of them P_c P_d |h_c^H S^-1 h_d|^2. Second differences of
the coefficients cost a little, and so do powers that are far below what stands beside them, which no line tells.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from ambid.arrays import ComplexArray, FloatArray

__all__ = ["SplitNoise"]

LINES = 1500
"""Lines that curves are fitted to, at the most."""
PER_OCTAVE = 1.0
"""Knots of a curve."""
PER_KNOT = 12
"""Lines around the lowest knot."""
STIFFNESS, HOLD = 0.3, 1e-3
"""What a second difference of coefficients costs, and what the square of the distance from the start does."""
STEPS, LARGEST, CLOSE = 25, 2.0, 1e-3
"""Of the scoring: steps, the largest change of a logarithm in one, and the rise of the likelihood, in units of one, that
is no longer worth another."""
EULER = 0.5772156649015329
"""Mean of -log of a power of unit mean, exponentially distributed."""


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
    """

    def __init__(self, lines: ComplexArray, way: ComplexArray, angle: FloatArray) -> None:
        self.heard = way.shape[2]
        few = _thinned(len(lines))
        self._scale = np.sqrt(np.mean(np.abs(lines) ** 2, axis=0))
        self._scale[self._scale == 0.0] = 1.0
        self._set_knots(angle)
        z, columns = lines[few] / self._scale, self._columns(way[few])
        self._fit(z, columns, self.basis(angle[few]), len(lines) / len(few))

    def _columns(self, way: ComplexArray) -> ComplexArray:
        """H of every line, channels in units of their rms, noises in units of those of the channels."""
        own = way * self._scale[: self.heard] / self._scale[:, None]
        one = np.broadcast_to(np.eye(way.shape[1], dtype=complex), (len(way), way.shape[1], way.shape[1]))
        return np.concatenate([own, one], axis=2)

    def _set_knots(self, angle: FloatArray) -> None:
        self._corner = angle[min(PER_KNOT, len(angle) - 1)]
        low, high = self._place(angle[[0, -1]])
        pieces = max(1, round((high - low) / np.log(2.0) * PER_OCTAVE))
        step = (high - low) / pieces
        self._range = low, high
        self._knots = low + step * np.arange(-3, pieces + 4)

    def _place(self, angle: FloatArray) -> FloatArray:
        return np.asarray(np.log(angle + self._corner))

    def basis(self, angle: FloatArray) -> FloatArray:
        """Splines at frequencies, shape (lines, splines)."""
        at = np.clip(self._place(angle), *self._range)
        return np.asarray(BSpline.design_matrix(at, self._knots, 3, extrapolate=True).toarray())

    def _fit(self, z: ComplexArray, columns: ComplexArray, basis: FloatArray, share: float) -> None:
        count, splines = basis.shape
        m = columns.shape[2]
        bend = np.diff(np.eye(splines), 2, axis=0)
        stiff = STIFFNESS * bend.T @ bend
        pairs = (basis[:, :, None] * basis[:, None, :]).reshape(count, -1)
        self._coefficients = start = self._start(z, columns, basis, stiff)
        cost = np.kron(np.eye(m), stiff + HOLD * np.eye(splines))
        held = lambda c: float(np.sum((c @ stiff) * c) + HOLD * np.sum((c - start) ** 2)) / 2.0  # noqa: E731
        state = self._state(z, columns, basis, self._coefficients)
        best, damping = state[0] - held(self._coefficients), 1e-3
        for _ in range(STEPS):
            score, information = self._normal(state, basis, pairs)
            pull = score - (self._coefficients @ stiff + HOLD * (self._coefficients - start))
            system = information + cost
            system[np.diag_indices_from(system)] *= 1.0 + damping
            step = np.linalg.solve(system, pull.ravel()).reshape(m, splines)
            step *= min(1.0, LARGEST / max(float(np.abs(step).max()), 1e-300))
            tried = self._coefficients + step
            other = self._state(z, columns, basis, tried)
            value = other[0] - held(tried)
            if value > best:
                rise, best, state, self._coefficients = value - best, value, other, tried
                damping = max(damping / 5.0, 1e-6)
                if rise < CLOSE * m:
                    break
            else:
                damping = max(10.0 * damping, 1e-2)
                if damping > 1e4:
                    break
        _, information = self._normal(state, basis, pairs)
        self._variance = np.linalg.inv(information + cost) / share
        self.numbers = float(np.trace(self._variance @ information)) * share

    def _start(self, z: ComplexArray, columns: ComplexArray, basis: FloatArray, stiff: FloatArray) -> FloatArray:
        """Coefficients of half of all power heard, and half not."""
        p, way = z.shape[1], columns[:, :, : self.heard]
        heard = np.linalg.lstsq(way[0], z[0], rcond=None)[0][None] if len(z) == 1 else self._heard(way, z)
        power = np.concatenate([np.abs(heard) ** 2, np.abs(z) ** 2], axis=1)
        level = np.log(np.maximum(power, 1e-12 * power.mean(axis=0) + 1e-300)) + EULER - np.log(2.0)
        system = basis.T @ basis + 3.0 * stiff + 1e-6 * np.eye(basis.shape[1])
        assert level.shape[1] == self.heard + p
        return np.asarray(np.linalg.solve(system, basis.T @ level).T)

    @staticmethod
    def _heard(way: ComplexArray, z: ComplexArray) -> ComplexArray:
        """Noise at the inputs that would make the channels that are read what they are."""
        heard = way.shape[2]
        return np.asarray(np.linalg.solve(way[:, :heard], z[:, :heard, None])[:, :, 0])

    def _state(self, z, columns, basis, coefficients):
        """Logarithm of the likelihood, scores on lines, and information on lines."""
        powers = np.exp(np.clip(basis @ coefficients.T, -60.0, 60.0))
        weighted = columns * np.sqrt(powers)[:, None, :]
        covariance = weighted @ weighted.conj().transpose(0, 2, 1)
        solved = np.linalg.solve(covariance, np.concatenate([weighted, z[:, :, None]], axis=2))
        inner = weighted.conj().transpose(0, 2, 1) @ solved
        found = np.abs(inner[:, :, -1]) ** 2 - inner[:, :, :-1].diagonal(axis1=1, axis2=2).real
        whole = np.einsum("lc,lc->", z.conj(), solved[:, :, -1]).real
        likelihood = -float(whole) - float(np.sum(np.linalg.slogdet(covariance)[1]))
        return likelihood, found, np.abs(inner[:, :, :-1]) ** 2

    @staticmethod
    def _normal(state, basis, pairs):
        _, scores, information = state
        m, splines = scores.shape[1], basis.shape[1]
        score = scores.T @ basis
        whole = (pairs.T @ information.reshape(len(information), -1)).reshape(splines, splines, m, m)
        return score, whole.transpose(2, 0, 3, 1).reshape(m * splines, m * splines)

    def powers(self, angle: FloatArray) -> FloatArray:
        """Of noise that is heard, then of noise that is not, shape (lines, heard + p)."""
        scale = np.concatenate([self._scale[: self.heard], self._scale]) ** 2
        return np.asarray(np.exp(np.clip(self.basis(angle) @ self._coefficients.T, -60.0, 60.0)) * scale)

    def covariance(self, way: ComplexArray, angle: FloatArray) -> ComplexArray:
        """S at frequencies, shape (lines, p, p)."""
        root = np.sqrt(np.exp(np.clip(self.basis(angle) @ self._coefficients.T, -60.0, 60.0)))
        weighted = self._columns(way) * root[:, None, :] * self._scale[:, None]
        return np.asarray(weighted @ weighted.conj().transpose(0, 2, 1))

    def unsure(self, way: ComplexArray, angle: FloatArray) -> FloatArray:
        """Numbers that the fit has taken at each line, over p: by so much is S too small in the mean."""
        basis, columns = self.basis(angle), self._columns(way)
        state = self._state(np.zeros((len(way), way.shape[1]), dtype=complex), columns, basis, self._coefficients)
        m, splines = len(self._coefficients), basis.shape[1]
        variance = self._variance.reshape(m, splines, m, splines).transpose(1, 3, 0, 2).reshape(splines**2, m * m)
        pairs = (basis[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
        own = (pairs @ variance).reshape(len(basis), m, m)
        return np.asarray(np.einsum("lcd,lcd->l", own, state[2]) / way.shape[1])


def _thinned(count: int) -> NDArray[np.intp]:
    """At most `LINES` of so many lines: all of the lowest, then every so many."""
    if count <= LINES:
        return np.arange(count)
    low = LINES // 3
    return np.concatenate([np.arange(low), np.linspace(low, count - 1, LINES - low).astype(np.intp)])
