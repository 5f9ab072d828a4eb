"""The misfit in units of the noise: J/dof, which is 1 when the model is right.

The residual r of y and i_c over M whole periods of N samples is Fourier transformed, R(l) = FFT(r)_l / sqrt(M N). The
excited lines l = M k hold what repeats, all others only noise; S(l), the p x p cross-spectrum of the noise, is the mean
of R R^H over the n_l unexcited lines within 15 excited lines to each side, or, where the residual is taken back through
the loop so that its noise is smooth over frequency, within a third of the frequency, though 60 lines at most, if the
lines themselves are as likely by that. Then

    J = 2 sum over l = M k of ((n_l - p) / n_l) R^H S^-1 R,     dof = 2 p K - parameters,

with Hotelling's factor and K excited lines (Pintelon and Schoukens, System Identification: A Frequency Domain
Approach, 2nd ed., chapters 9 and 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.noise.local import beside_excitation
from ambid.noise.window import Window

HALF_WIDTH = 15
"""Excited lines to each side whose unexcited neighbours give the noise spectrum."""
SMOOTH = 1.0 / 3.0
"""Part of a line's frequency over which noise is flat, once the loop's own shape is taken out of it."""
WIDEST = 60
"""Excited lines to each side that are enough in any case."""
TRIED = 5
"""One of so many unexcited lines tells whether noise is that smooth."""


@dataclass(frozen=True)
class Whitener:
    """Noise of the residual on the lines of one record that are judged; frozen during a fit.

    Attributes
    ----------
    window : Window
    more : ndarray of int
        Lines that are judged beyond the excited ones.
    whitening : ndarray, shape (lines, p, p)
        Inverse of the Cholesky factors of ``S n_l / (n_l - p)``, times the root of two.
    spread : ndarray, shape (lines,)
        Variance of whitened noise on the direction of a whitened response, n_l / (n_l - p): where S is by chance too
        small both are large, which J, whose mean is 1 all the same, does not show.
    """

    window: Window
    more: NDArray[np.intp]
    whitening: ComplexArray
    spread: FloatArray

    @classmethod
    def from_residual(
        cls,
        residual: FloatArray,
        window: Window,
        excitation: FloatArray | None = None,
        more: NDArray[np.intp] | None = None,
        shape: ComplexArray | None = None,
    ) -> Whitener:
        """Estimate the noise from the unexcited lines, or from what does not follow the excitation.

        Parameters
        ----------
        residual : ndarray, shape (samples, p)
            Of the whole record, from its first sample on, without tones.
        window : Window
        excitation : ndarray, shape (samples, axes), optional
            Of the same record; needed where it has no periods.
        more : ndarray of int, optional
            Unexcited lines that are to be judged too.
        shape : ndarray, shape (M N / 2 + 1, p, p), optional
            What makes the noise of each line smooth over frequency, such as the way back through the loop; without
            periods it is used where it makes the residual likelier.

        Raises
        ------
        RecordError
            If there is no noise, or the record is too short to tell it from what follows the excitation.
        """
        more = np.zeros(0, dtype=np.intp) if more is None else more
        lines = window.lines(residual)
        judged = np.concatenate([window.excited, more])
        if excitation is None or window.is_periodic:
            back, smooth = (_unshaped(lines), 0.0) if shape is None else (shape, SMOOTH)
            spectrum, spread = _between_lines(_through(back, lines), window, judged, smooth)
        else:
            shapes = [_unshaped(lines), *([] if shape is None else [shape])]
            inputs = window.lines(excitation)
            tried = [(beside_excitation(_through(back, lines), inputs)[judged], back) for back in shapes]
            spectrum, back = max(tried, key=lambda one: _likelihood(one[0], one[1][judged]))
            spread = np.ones(len(judged))
        try:
            whitening = np.sqrt(2.0) * np.linalg.inv(np.linalg.cholesky(spectrum))
        except np.linalg.LinAlgError:
            raise RecordError(
                "a record holds no noise on some channel, so that there is no misfit in units of it; "
                "if it was simulated, add noise as `virtual_experiment` does"
            ) from None
        return cls(window, more, whitening @ back[judged], spread)

    def whiten(self, signal: FloatArray) -> FloatArray:
        """Whitened judged lines of a signal of shape (samples, p) or (samples, p, q), as real numbers.

        Returns
        -------
        ndarray, shape (2 lines p,) or (2 lines p, q)
            Its sum of squares is J when `signal` is the residual.
        """
        return self._white(self.window.some_lines(signal, self.more))

    def whiten_period(self, period: FloatArray) -> FloatArray:
        """The same of a signal that does nothing but repeat this period, shape (N, p)."""
        window = self.window
        lines = rfft(period, axis=0)[window.in_period] * np.sqrt(window.periods / window.period)
        return self._white(np.concatenate([lines, np.zeros((len(self.more), lines.shape[1]))]))

    def _white(self, lines: ComplexArray) -> FloatArray:
        white = self.whitening @ (lines if lines.ndim == 3 else lines[..., None])
        white = white.reshape(-1, white.shape[-1])
        both = np.concatenate([white.real, white.imag])
        return both if lines.ndim == 3 else both[:, 0]

    @property
    def spreads(self) -> FloatArray:
        """`spread` of every number that `whiten` returns."""
        return np.tile(np.repeat(self.spread, self.whitening.shape[1]), 2)

    @property
    def numbers(self) -> int:
        """Real numbers that `whiten` returns: 2 p per line."""
        return 2 * self.whitening.shape[0] * self.whitening.shape[1]


def _unshaped(lines: ComplexArray) -> ComplexArray:
    return np.broadcast_to(np.eye(lines.shape[1], dtype=complex), (len(lines), lines.shape[1], lines.shape[1]))


def _through(shape: ComplexArray, lines: ComplexArray) -> ComplexArray:
    return np.asarray((shape @ lines[..., None])[..., 0])


def _likelihood(spectrum: ComplexArray, shape: ComplexArray) -> float:
    """Logarithm of the likelihood that a residual has this spectrum after its shape, but for a constant (Whittle)."""
    return float(np.sum(2.0 * np.linalg.slogdet(shape)[1] - np.linalg.slogdet(spectrum)[1]))


def _between_lines(
    lines: ComplexArray, window: Window, judged: NDArray[np.intp], smooth: float
) -> tuple[ComplexArray, FloatArray]:
    """``S n_l / (n_l - p)`` at the judged lines from the unexcited ones around, (judged, p, p), and n_l / (n_l - p)."""
    p = lines.shape[1]
    power = np.einsum("lc,ld->lcd", lines, lines.conj())
    quiet = np.ones(len(lines))
    quiet[:: window.periods] = quiet[-1] = 0.0
    power *= quiet[:, None, None]
    below = np.concatenate([np.zeros((1, p, p)), np.cumsum(power, axis=0)])
    count_below = np.concatenate([[0.0], np.cumsum(quiet)])

    def around(at: NDArray[np.intp], smooth: float) -> tuple[ComplexArray, FloatArray]:
        reach = np.clip((smooth * at).astype(np.intp), HALF_WIDTH * window.periods, WIDEST * window.periods)
        low, high = np.maximum(at - reach, 0), np.minimum(at + reach + 1, len(lines))
        return below[high] - below[low], count_below[high] - count_below[low]

    if smooth:
        tried = np.flatnonzero(quiet)[WIDEST::TRIED]
        narrow, wide = (_left_out(lines[tried], *around(tried, own)) for own in (0.0, smooth))
        smooth = smooth if wide >= narrow else 0.0  # noise with narrow peaks of its own
    total, count = around(judged, smooth)
    return np.asarray(total / (count - p)[:, None, None]), count / (count - p)


def _left_out(lines: ComplexArray, total: ComplexArray, count: FloatArray) -> float:
    """Logarithm of the likelihood of lines, each by the spectrum of those around it, but for a constant (Whittle)."""
    p = lines.shape[1]
    spectrum = (total - np.einsum("lc,ld->lcd", lines, lines.conj())) / (count - 1.0 - p)[:, None, None]
    try:
        white = np.linalg.solve(np.linalg.cholesky(spectrum), lines[..., None])
    except np.linalg.LinAlgError:
        return -np.inf  # no noise on some channel
    return float(-np.sum(np.abs(white) ** 2) - np.sum(np.linalg.slogdet(spectrum)[1]))


def channel_lines(residual: FloatArray, window: Window, excitation: FloatArray | None = None) -> FloatArray:
    """Whitened excited lines of each channel, judged against its own noise alone, shape (2, K, p)."""
    single = (channel[:, None] for channel in residual.T)
    parts = [Whitener.from_residual(channel, window, excitation).whiten(channel) for channel in single]
    return np.stack(parts, axis=-1).reshape(2, -1, residual.shape[1])


def channel_misfit(residual: FloatArray, window: Window, excitation: FloatArray | None = None) -> FloatArray:
    """J/dof of each channel alone, shape (p,)."""
    return np.mean(channel_lines(residual, window, excitation) ** 2, axis=(0, 1))
