"""The noise of a record on the lines that are judged, from lines that are not excited.

The residual on unexcited lines, its transient taken out, is taken back through the loop, e = H^-1 R, so that its noise
is smooth over frequency. S(l), the p x p cross-spectrum of e, is the mean of e e^H over the n_l unexcited lines around,
within a third of the frequency, though 60 excited lines to each side at most; or within 15, if the lines themselves
are likelier by that. What is judged is then

    J = 2 sum over l of ((n_l - p) / n_l) R^H (H S H^H)^-1 R

with Hotelling's factor (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapters
9 and 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError

__all__ = ["PER_CHANNEL", "Spectrum", "between_lines"]

HALF_WIDTH = 15
"""Excited lines to each side whose unexcited neighbours give the noise spectrum, if they are enough."""
SMOOTH = 1.0 / 3.0
"""Part of a line's frequency over which noise is flat, once the loop's own shape is taken out of it."""
WIDEST = 60
"""Excited lines to each side that are enough in any case."""
PER_CHANNEL = 10
"""Unexcited lines per channel that a spectrum of all channels needs, for a spread of 10/9 over exact whitening."""
TRIED = 9
"""One of so many unexcited lines tells whether noise is that smooth."""
OUTLYING = 70.0
"""Power of a channel on a line, over its spectrum, above which it is no noise but a tone."""


@dataclass(frozen=True)
class Spectrum:
    """Noise on judged lines.

    Attributes
    ----------
    inner : ndarray, shape (lines, p, p)
        Inverse of the Cholesky factors of ``S n_l / (n_l - p)``, times the root of two.
    whitening : ndarray, shape (lines, p, p)
        The same behind the way back through the loop.
    spread : ndarray, shape (lines,)
        Variance of whitened noise on the direction of a whitened response, n_l / (n_l - p): where S is by chance too
        small both are large, which J, whose mean is 1 all the same, does not show.
    """

    inner: ComplexArray
    whitening: ComplexArray
    spread: FloatArray

    @classmethod
    def of(cls, covariance: ComplexArray, back: ComplexArray, spread: FloatArray) -> Spectrum:
        """From the covariance of the lines that `back` has been applied to.

        Raises
        ------
        RecordError
            If there is no noise on some channel.
        """
        try:
            inner = np.sqrt(2.0) * np.linalg.inv(np.linalg.cholesky(covariance))
        except np.linalg.LinAlgError:
            raise RecordError(
                "a record holds no noise on some channel, so that there is no misfit in units of it; "
                "if it was simulated, add noise as `virtual_experiment` does"
            ) from None
        return cls(inner, inner @ back, spread)


def between_lines(quiet: ComplexArray, at: FloatArray, judged: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """``S n_l / (n_l - p)`` at the judged lines from unexcited ones, shape (judged, p, p), and n_l / (n_l - p).

    Parameters
    ----------
    quiet : ndarray, shape (lines, p)
        Unexcited lines, in order of frequency.
    at, judged : ndarray
        Their places, and those of the judged lines, in excited lines (cycles per period).

    Raises
    ------
    RecordError
        If the record has too few lines for so many channels.
    """
    p = quiet.shape[1]
    if len(quiet) <= 2 * p:
        raise RecordError(
            f"{len(quiet)} unexcited lines are too few to tell the noise of {p} channels; record more periods, or "
            "excite with a longer period"
        )
    extent = at[-1] - at[0]
    narrow = min(max(HALF_WIDTH, 0.5 * PER_CHANNEL * p * extent / len(quiet)), 0.5 * extent)
    wide = min(max(WIDEST, narrow), 0.5 * extent)
    lines, usual = _Lines(quiet, at), np.ones(len(quiet), dtype=bool)
    tried = np.arange(len(quiet))[::TRIED]
    for _ in range(2):  # the second time without tones
        sums = lines.summed(usual)
        flat, smooth = (lines.left_out(sums, tried, _reach(at[tried], narrow, wide, own)) for own in (0.0, SMOOTH))
        part = SMOOTH if smooth >= flat else 0.0  # noise may have narrow peaks of its own
        total, count = sums.around(at, _reach(at, narrow, wide, part))
        own = np.abs(quiet) ** 2 * count[:, None]
        outlying = (own > OUTLYING * np.einsum("lcc->lc", total).real).any(axis=1)
        if not outlying.any():
            break
        usual = ~outlying
    total, count = sums.around(judged, _reach(judged, narrow, wide, part))
    return np.asarray(total / (count - p)[:, None, None]), count / (count - p)


def _reach(at: FloatArray, narrow: float, wide: float, part: float) -> FloatArray:
    return np.clip(part * at, narrow, wide)


@dataclass(frozen=True)
class _Sums:
    """Sums of e e^H from the first line on, and how many they hold."""

    at: FloatArray
    below: ComplexArray
    count: FloatArray

    def around(self, places: FloatArray, reach: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """Sum and number of lines within reach of each place; near the ends, as many more on the other side."""
        middle = np.clip(places, self.at[0] + reach, self.at[-1] - reach)
        low = np.searchsorted(self.at, middle - reach - 1e-9)
        high = np.searchsorted(self.at, middle + reach + 1e-9)
        return self.below[high] - self.below[low], self.count[high] - self.count[low]


class _Lines:
    """Unexcited lines at their places, with their own e e^H."""

    def __init__(self, lines: ComplexArray, at: FloatArray) -> None:
        self.lines, self.at = lines, at
        self.own = lines[:, :, None] * lines.conj()[:, None, :]

    def summed(self, used: NDArray[np.bool_]) -> _Sums:
        p = self.lines.shape[1]
        below = np.concatenate([np.zeros((1, p, p)), np.cumsum(self.own * used[:, None, None], axis=0)])
        return _Sums(self.at, below, np.concatenate([[0.0], np.cumsum(used)]))

    def left_out(self, sums: _Sums, tried: NDArray[np.intp], reach: FloatArray) -> float:
        """Logarithm of the likelihood of lines, each by the spectrum of those around, but for a constant (Whittle)."""
        total, count = sums.around(self.at[tried], reach)
        spectrum = (total - self.own[tried]) / np.maximum(count - 1.0 - self.lines.shape[1], 1.0)[:, None, None]
        try:
            white = np.linalg.solve(np.linalg.cholesky(spectrum), self.lines[tried][..., None])
        except np.linalg.LinAlgError:
            return -np.inf  # no noise on some channel
        return float(-np.sum(np.abs(white) ** 2) - np.sum(np.linalg.slogdet(spectrum)[1]))
