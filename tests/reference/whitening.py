"""Signals on the lines of a window, whitened by the lines between the excited ones or beside an excitation."""

from dataclasses import dataclass

import numpy as np

from ambid.noise.local import beside_excitation
from ambid.noise.whitener import Spectrum, between_lines
from ambid.noise.window import Window


@dataclass(frozen=True)
class Whitening:
    """The noise of a residual on the excited lines of a window."""

    window: Window
    spectrum: Spectrum

    @classmethod
    def between(cls, residual: np.ndarray, window: Window) -> "Whitening":
        index = window.between(window.periods)
        quiet = window.lines(residual)[index]
        judged = window.excited / window.periods
        covariance, spread = between_lines(quiet, index / window.periods, judged)
        unshaped = np.tile(np.eye(quiet.shape[1], dtype=complex), (len(judged), 1, 1))
        return cls(window, Spectrum.of(covariance, unshaped, spread))

    @classmethod
    def beside(cls, residual: np.ndarray, excitation: np.ndarray, window: Window) -> "Whitening":
        at = window.excited
        [found] = beside_excitation([window.lines(residual)[at]], window.lines(excitation)[at])
        covariance = found.spectrum
        unshaped = np.tile(np.eye(covariance.shape[1], dtype=complex), (len(at), 1, 1))
        return cls(window, Spectrum.of(covariance, unshaped, np.ones(len(at))))

    def white(self, signal: np.ndarray) -> np.ndarray:
        """Real and imaginary parts by line and channel; of shape (numbers,) or (numbers, q) for q signals."""
        lines = self.window.lines(signal)[self.window.excited]
        lines = lines if lines.ndim == 3 else lines[..., None]
        white = self.spectrum.whitening @ lines
        white = np.stack([white.real, white.imag], axis=2).reshape(-1, lines.shape[2])
        return white if signal.ndim == 3 else white[:, 0]

    @property
    def spreads(self) -> np.ndarray:
        return np.repeat(self.spectrum.spread, 2 * self.spectrum.inner.shape[1])
