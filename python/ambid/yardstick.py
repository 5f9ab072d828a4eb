"""The misfit in units of the noise: J/dof, which is 1 when the model is right.

The residual r of y and i_c over M whole periods of N samples is Fourier transformed, R(l) = FFT(r)_l / sqrt(M N). The
excited lines l = M k hold what repeats, all others only noise; S(l), the p x p cross-spectrum of the noise, is the mean
of R R^H over the n_l unexcited lines within 15 excited lines to each side. Then

    J = 2 sum over l = M k of ((n_l - p) / n_l) R^H S^-1 R,     dof = 2 p K - parameters,

with Hotelling's factor and K excited lines (Pintelon and Schoukens, System Identification: A Frequency Domain
Approach, 2nd ed., chapters 9 and 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.loop.assembly import FloatArray

ComplexArray = NDArray[np.complex128]

HALF_WIDTH = 15
"""Excited lines to each side whose unexcited neighbours give the noise spectrum."""


@dataclass(frozen=True)
class Window:
    """The whole periods of a record after the first, which holds the transient.

    Attributes
    ----------
    period : int
        Samples N per period.
    periods : int
        Number M of periods that count.
    """

    period: int
    periods: int

    @property
    def samples(self) -> int:
        """M N."""
        return self.period * self.periods

    @property
    def excited(self) -> NDArray[np.intp]:
        """Indices of the excited lines, neither DC nor the highest."""
        return self.periods * np.arange(1, (self.period + 1) // 2)

    def cut(self, signal: FloatArray) -> FloatArray:
        """The samples that count, of a signal that starts with the record."""
        return signal[self.period : self.period + self.samples]

    def lines(self, signal: FloatArray) -> ComplexArray:
        """R(l) for l = 0 .. M N / 2 of a signal of shape (samples, ...), which starts with the record."""
        return rfft(self.cut(signal), axis=0) / np.sqrt(self.samples)

    def some_lines(self, signal: FloatArray, more: NDArray[np.intp]) -> ComplexArray:
        """R(l) of the excited lines, then of a few more; the mean over the periods holds all that is excited."""
        part = self.cut(signal)
        folded = part.reshape(self.periods, self.period, *part.shape[1:]).sum(axis=0)
        lines = rfft(folded, axis=0)[1 : (self.period + 1) // 2]
        if len(more):
            angles = 2.0 * np.pi / self.samples * np.outer(more, np.arange(self.samples))
            flat = part.reshape(self.samples, -1)
            others = np.cos(angles) @ flat - 1j * (np.sin(angles) @ flat)
            lines = np.concatenate([lines, others.reshape(len(more), *part.shape[1:])])
        return lines / np.sqrt(self.samples)


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
    """

    window: Window
    more: NDArray[np.intp]
    whitening: ComplexArray

    @classmethod
    def from_residual(
        cls,
        residual: FloatArray,
        window: Window,
        more: NDArray[np.intp] | None = None,
        shape: ComplexArray | None = None,
    ) -> Whitener:
        """Estimate the noise from the unexcited lines.

        Parameters
        ----------
        residual : ndarray, shape (samples, p)
            Of the whole record, from its first sample on, without tones.
        window : Window
            At least 2 periods.
        more : ndarray of int, optional
            Unexcited lines that are to be judged too.
        shape : ndarray, shape (M N / 2 + 1, p, p), optional
            What makes the noise of each line smooth over frequency, such as the way back through the loop.
        """
        more = np.zeros(0, dtype=np.intp) if more is None else more
        lines = window.lines(residual)
        if shape is not None:
            lines = (shape @ lines[..., None])[..., 0]
        p = residual.shape[1]
        power = np.einsum("lc,ld->lcd", lines, lines.conj())
        quiet = np.ones(len(lines))
        quiet[:: window.periods] = quiet[-1] = 0.0
        power *= quiet[:, None, None]
        below = np.concatenate([np.zeros((1, p, p)), np.cumsum(power, axis=0)])
        count_below = np.concatenate([[0.0], np.cumsum(quiet)])
        judged = np.concatenate([window.excited, more])
        reach = HALF_WIDTH * window.periods
        low, high = np.maximum(judged - reach, 0), np.minimum(judged + reach + 1, len(lines))
        count = count_below[high] - count_below[low]
        spectrum = (below[high] - below[low]) / (count - p)[:, None, None]  # S n_l / (n_l - p)
        whitening = np.sqrt(2.0) * np.linalg.inv(np.linalg.cholesky(spectrum))
        return cls(window, more, whitening if shape is None else whitening @ shape[judged])

    def whiten(self, signal: FloatArray) -> FloatArray:
        """Whitened judged lines of a signal of shape (samples, p) or (samples, p, q), as real numbers.

        Returns
        -------
        ndarray, shape (2 lines p,) or (2 lines p, q)
            Its sum of squares is J when `signal` is the residual.
        """
        lines = self.window.some_lines(signal, self.more)
        white = self.whitening @ (lines if lines.ndim == 3 else lines[..., None])
        white = white.reshape(-1, white.shape[-1])
        both = np.concatenate([white.real, white.imag])
        return both if signal.ndim == 3 else both[:, 0]

    @property
    def numbers(self) -> int:
        """Real numbers that `whiten` returns: 2 p per line."""
        return 2 * self.whitening.shape[0] * self.whitening.shape[1]


def channel_lines(residual: FloatArray, window: Window) -> FloatArray:
    """Whitened excited lines of each channel, judged against its own noise alone, shape (2, K, p)."""
    parts = [Whitener.from_residual(channel[:, None], window).whiten(channel[:, None]) for channel in residual.T]
    return np.stack(parts, axis=-1).reshape(2, -1, residual.shape[1])


def channel_misfit(residual: FloatArray, window: Window) -> FloatArray:
    """J/dof of each channel alone, shape (p,)."""
    return np.mean(channel_lines(residual, window) ** 2, axis=(0, 1))
