"""The noise of a record on the lines that are judged, from lines that are not excited.

The residual on unexcited lines, its transient taken out, is taken back through the loop, e = H^-1 R, so that its noise
is smooth over frequency. S(l), the p x p cross-spectrum of e, is the mean of e e^H over the n_l unexcited lines around:
how many, and whether full matrices or powers of single channels with one matrix of correlations, is what makes every
line likeliest by those around it (`between_lines`). What is judged is then

    J = 2 sum over l of ((n_l - p) / n_l) R^H (H S H^H)^-1 R

with Hotelling's factor (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapters
9 and 10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import ModelError, RecordError
from ambid.noise.envelope import Envelope
from ambid.noise.wave import OUTSTANDING

HALF_WIDTH = 15
"""Excited lines to each side whose unexcited neighbours give the noise spectrum, if they are enough."""
SMOOTH = 1.0 / 3.0
"""Part of a line's frequency over which noise is flat, once the loop's own shape is taken out of it."""
NARROWEST = 2
"""Excited lines to each side that give the power of a single channel, if they are enough."""
WIDEST = 60
"""Excited lines to each side that are enough in any case."""
PER_CHANNEL = 10
"""Unexcited lines per channel that a spectrum of all channels needs, for a spread of 10/9 over exact whitening."""
TRIED = 9
"""One of so many unexcited lines shows whether noise is that smooth."""
SILENT = (
    "a record holds no noise on some channel, so that there is no misfit in units of it; if it was simulated, add "
    "noise as `virtual_experiment` does"
)


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
    raised : ndarray, shape (lines,)
        What stands in place of S over S itself, in the mean: n_l / (n_l - p), so that J has a mean of 1.
    """

    inner: ComplexArray
    whitening: ComplexArray
    spread: FloatArray
    raised: FloatArray

    @classmethod
    def of(
        cls, covariance: ComplexArray, back: ComplexArray, spread: FloatArray, raised: FloatArray | None = None
    ) -> Spectrum:
        """From the covariance of the lines that `back` has been applied to; it is raised by its spread, unless given.

        Raises
        ------
        RecordError
            If there is no noise on some channel.
        """
        try:
            inner, whitening = _core.whitening(covariance, back)
        except ModelError:
            raise RecordError(SILENT) from None
        return cls(inner, whitening, spread, spread if raised is None else raised)


def require_noise(covariance: ComplexArray, back: ComplexArray, recorded: ComplexArray) -> None:
    """Refuse noise that is nothing but rounding, beside the lines that were recorded.

    Raises
    ------
    RecordError
        If a channel holds no more.
    """
    signal = np.sum(np.abs(_core.through(back, recorded)) ** 2, axis=0)
    # noise below that is rounding of the signal
    if (np.einsum("lcc->c", covariance).real < 1e-20 * signal).any():
        raise RecordError(SILENT)


def between_lines(quiet: ComplexArray, at: FloatArray, judged: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """The covariance of the noise at the judged lines from unexcited ones, (judged, p, p), and its spread n / (n - q).

    Four ways compete, and the one under which every line is likeliest by those around it is taken: full matrices over
    a part of the frequency or over a few lines, and, for noise with narrow peaks of its own, powers of single channels
    over `HALF_WIDTH` or fewer lines with one matrix of correlations for all frequencies. Each is tried with the lines
    as they are, and with an `Envelope` of every channel taken out of them.

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
    return around(quiet, at).covariance(judged)


def likelier_shape(fits: Sequence[Around], backs: Sequence[ComplexArray], numbers: Sequence[float]) -> int:
    """Behind which of several shapes unexcited lines are likeliest, each by those around it as in `between_lines`.

    Parameters
    ----------
    fits : sequence of Around
        Of the lines behind each shape.
    backs : sequence of ndarray, shape (lines, p, p)
        What took them there.
    numbers : sequence of float
        That were fitted to the lines for each shape.
    """
    count = len(backs[0])
    tried = np.arange(count)[::TRIED]
    tried = tried[np.logical_and.reduce([fit.lines.used[tried] for fit in fits])]
    gains = [2.0 * float(np.sum(np.linalg.slogdet(back[tried])[1])) for back in backs]
    own = [gain + fit.likelihood(tried) for gain, fit in zip(gains, fits, strict=True)]
    return int(np.argmax(np.array(own) - len(tried) / count * np.array(numbers)))


def around(quiet: ComplexArray, at: FloatArray) -> Around:
    """The likeliest way to estimate a line's noise from those around it, see `between_lines`."""
    p = quiet.shape[1]
    if len(quiet) <= 2 * p:
        raise RecordError(
            f"{len(quiet)} unexcited lines are too few to estimate the noise of {p} channels; record more periods, or "
            "excite with a longer period"
        )
    extent = at[-1] - at[0]
    density = len(quiet) / extent
    half = 0.5 * extent
    full = min(max(HALF_WIDTH, 0.5 * PER_CHANNEL * p / density), half)
    single = min(max(NARROWEST, 0.5 * PER_CHANNEL / density), half)
    ways = [
        _Way(full, min(max(WIDEST, full), half), SMOOTH),
        _Way(full, full, 0.0),
        _Way(min(HALF_WIDTH, half), min(HALF_WIDTH, half), 0.0, factored=True),
        _Way(single, single, 0.0, factored=True),
    ]
    usual = np.ones(len(quiet), dtype=bool)
    tried = np.arange(len(quiet))[::TRIED]
    for _ in range(2):  # the second time without tones
        lines = _Lines(quiet, at, usual)
        way, likelihood = lines.likeliest(ways, tried[usual[tried]])
        power = lines.powers(at, way)
        outlying = np.any(quiet.real**2 + quiet.imag**2 > OUTSTANDING * power, axis=1)
        if not np.any(outlying):
            break
        usual = np.logical_not(outlying)
    nyquist = at[0] + at[-1]
    envelope = Envelope(np.abs(quiet[usual]) ** 2, np.pi * at[usual] / nyquist)
    if envelope.orders.any():
        flat = _Lines(quiet / envelope.root(np.pi * at / nyquist), at, usual)
        some = tried[usual[tried]]
        other, _ = flat.likeliest(ways, some)
        even = Around(flat, other, envelope)
        if even.likelihood(some) > likelihood:
            return even
    return Around(lines, way)


@dataclass(frozen=True)
class _Way:
    """How far the lines may be that give the noise at a place, in excited lines, and what they show of it."""

    least: float
    most: float
    part: float
    factored: bool = False

    def reach(self, places: FloatArray) -> FloatArray:
        return np.clip(self.part * places, self.least, self.most)


class _Lines:
    """Unexcited lines at their places; those that are not used count for nothing."""

    def __init__(self, lines: ComplexArray, at: FloatArray, used: NDArray[np.bool_]) -> None:
        self.lines, self.at, self.used = lines, at, used
        self.scatter = _core.Scatter(lines, used)
        power = (lines.real**2 + lines.imag**2) * used[:, None]
        self.below = np.concatenate([np.zeros((1, lines.shape[1])), np.cumsum(power, axis=0)])
        self.count = np.concatenate([[0.0], np.cumsum(used)])
        self._correlations: dict[_Way, ComplexArray] = {}
        self._likelihoods: dict[tuple[bytes, _Way], float] = {}

    def around(self, places: FloatArray, way: _Way) -> tuple[NDArray[np.uintp], NDArray[np.uintp]]:
        """First and last of the lines around each place; near the ends, more on the other side."""
        reach = way.reach(places)
        middle = np.clip(places, self.at[0] + reach, self.at[-1] - reach)
        low = np.searchsorted(self.at, middle - reach - 1e-9)
        high = np.searchsorted(self.at, middle + reach + 1e-9)
        return low.astype(np.uintp), high.astype(np.uintp)

    def powers(self, places: FloatArray, way: _Way) -> FloatArray:
        """Of single channels, shape (places, p)."""
        low, high = self.around(places, way)
        count = self.count[high] - self.count[low]
        return np.asarray((self.below[high] - self.below[low]) / count[:, None])

    def correlation(self, way: _Way) -> ComplexArray:
        """Of the channels, over all frequencies."""
        if way not in self._correlations:
            root = np.sqrt(np.maximum(self.powers(self.at, way), 1e-300))
            scaled = self.lines[self.used] / root[self.used]
            found = scaled.T @ scaled.conj()
            size = np.sqrt(np.diag(found).real)
            self._correlations[way] = found / np.outer(size, size)
        return self._correlations[way]

    def covariance(
        self, places: FloatArray, way: _Way, left_out: NDArray[np.intp] | None = None
    ) -> tuple[ComplexArray, FloatArray]:
        """Covariance at places, by lines around without those left out, and its spread."""
        low, high = self.around(places, way)
        total = self.scatter.between(low, high, None if left_out is None else left_out.astype(np.uintp))
        count = self.count[high] - self.count[low] - (0.0 if left_out is None else 1.0)
        free = np.maximum(count - (1.0 if way.factored else self.lines.shape[1]), 0.5)
        if not way.factored:
            return np.asarray(total * (1.0 / free)[:, None, None]), count / free
        # the correlations come from all lines, though no more than those
        everything = float(self.count[-1])
        free *= max(1.0 - self.lines.shape[1] / everything, 0.05)
        root = np.sqrt(np.einsum("lcc->lc", total).real / free[:, None])
        return np.asarray(root[:, :, None] * self.correlation(way) * root[:, None, :]), count / free

    def likeliest(self, ways: Sequence[_Way], tried: NDArray[np.intp]) -> tuple[_Way, float]:
        """The way that makes lines likeliest, and the logarithm of their likelihood."""
        found = [self.likelihood(tried, way) for way in ways]
        best = int(np.argmax(found))
        return ways[best], found[best]

    def likelihood(self, tried: NDArray[np.intp], way: _Way) -> float:
        """Logarithm of the likelihood of lines, each by the spectrum of those around, but for a constant (Whittle).

        Single channels know nothing of how mixtures of them go together: only where that is clearly likelier.
        """
        key = tried.tobytes(), way
        if key not in self._likelihoods:
            covariance, _ = self.covariance(self.at[tried], way, tried)
            try:
                found = _core.whittle(covariance, self.lines[tried]) - self.lines.shape[1] ** 2 * way.factored
            except ModelError:
                found = -np.inf  # no noise on some channel
            self._likelihoods[key] = found
        return self._likelihoods[key]


@dataclass(frozen=True)
class Around:
    """How lines give the noise between them, with the envelope that was taken out of them, if any."""

    lines: _Lines
    way: _Way
    envelope: Envelope | None = None

    def likelihood(self, tried: NDArray[np.intp]) -> float:
        """Of lines as they were before the envelope was taken out, see `_Lines.likelihood`."""
        found = self.lines.likelihood(tried, self.way)
        if self.envelope is None:
            return found
        root = self.envelope.root(self._angle(self.lines.at[tried]))
        share = len(tried) / len(self.lines.at)
        return found - 2.0 * float(np.sum(np.log(root))) - float(np.sum(self.envelope.orders)) * share

    def covariance(self, places: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """At places, with its spread."""
        covariance, spread = self.lines.covariance(places, self.way)
        if self.envelope is None:
            return covariance, spread
        angle = self._angle(places)
        unsure = 1.0 + self.envelope.variance(angle)
        shape = self.envelope.root(angle) * np.sqrt(unsure)
        return covariance * shape[:, :, None] * shape[:, None, :], spread * unsure.mean(axis=1)

    def _angle(self, places: FloatArray) -> FloatArray:
        return np.asarray(np.pi * places / (self.lines.at[0] + self.lines.at[-1]))


def whitened(whitening: ComplexArray, lines: ComplexArray) -> FloatArray:
    """Lines of shape (lines, p) or (lines, p, q) times the whitening of each, as real numbers."""
    white = whitening @ (lines if lines.ndim == 3 else lines[..., None])
    flat = np.stack([white.real, white.imag], axis=2).reshape(2 * white.shape[0] * white.shape[1], white.shape[-1])
    return flat if lines.ndim == 3 else flat[:, 0]
