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

    def lines(self, signal: FloatArray) -> ComplexArray:
        """R(l) for l = 0 .. M N / 2 of a signal of shape (samples, ...), which starts with the record."""
        n = self.period * self.periods
        return rfft(signal[self.period : self.period + n], axis=0) / np.sqrt(n)

    @property
    def excited(self) -> NDArray[np.intp]:
        """Indices of the excited lines, neither DC nor the highest."""
        return self.periods * np.arange(1, (self.period + 1) // 2)


@dataclass(frozen=True)
class Whitener:
    """Noise of the residual on the excited lines of one record; frozen during a fit.

    Attributes
    ----------
    window : Window
    factor : ndarray, shape (K, p, p)
        Lower Cholesky factors of ``S n_l / (n_l - p)`` on the excited lines.
    """

    window: Window
    factor: ComplexArray

    @classmethod
    def from_residual(cls, residual: FloatArray, window: Window) -> Whitener:
        """Estimate the noise from the unexcited lines.

        Parameters
        ----------
        residual : ndarray, shape (samples, p)
            Of the whole record, from its first sample on.
        window : Window
            At least 2 periods.
        """
        lines = window.lines(residual)
        p, excited = residual.shape[1], window.excited
        power = np.einsum("lc,ld->lcd", lines, lines.conj())
        power[0] = power[:: window.periods] = 0.0
        quiet = np.ones(len(lines))
        quiet[:: window.periods] = 0.0
        quiet[-1] = 0.0
        power[-1] = 0.0
        below = np.concatenate([np.zeros((1, p, p)), np.cumsum(power, axis=0)])
        count_below = np.concatenate([[0.0], np.cumsum(quiet)])
        reach = HALF_WIDTH * window.periods
        low, high = np.maximum(excited - reach, 0), np.minimum(excited + reach + 1, len(lines))
        count = count_below[high] - count_below[low]
        spectrum = (below[high] - below[low]) / (count - p)[:, None, None]  # S n_l / (n_l - p)
        return cls(window, np.linalg.cholesky(spectrum))

    def whiten(self, signal: FloatArray) -> FloatArray:
        """Whitened excited lines of a signal of shape (samples, p), as real numbers of shape (2, K, p).

        Their sum of squares is J when `signal` is the residual.
        """
        lines = self.window.lines(signal)[self.window.excited]
        white = np.sqrt(2.0) * np.linalg.solve(self.factor, lines[..., None])[..., 0]
        return np.stack([white.real, white.imag])


def channel_lines(residual: FloatArray, window: Window) -> FloatArray:
    """Whitened excited lines of each channel, judged against its own noise alone, shape (2, K, p)."""
    parts = []
    for channel in residual.T:
        own = Whitener.from_residual(channel[:, None], window)
        parts.append(own.whiten(channel[:, None])[..., 0])
    return np.stack(parts, axis=-1)


def channel_misfit(residual: FloatArray, window: Window) -> FloatArray:
    """J/dof of each channel alone, shape (p,)."""
    return np.mean(channel_lines(residual, window) ** 2, axis=(0, 1))
