"""A record whose samples fade away: lines on a circle outside of the unit circle, on which every pole is damped more.

Of ``x[k] exp(-rate t[k])`` the loop on lines holds at ``w exp(rate dt)``, transient included: resonances are wider by
`rate`, and a loop may grow as fast without being unstable. A fit that the true one's sharp resonances or the edge of
stability keep away from it finds the way there, and with ever less damping back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.noise.window import Window


@dataclass(frozen=True)
class DampedWindow(Window):
    """A window in which samples fade away.

    Attributes
    ----------
    fading : float
        By ``exp(-fading)`` from each sample to the next.
    """

    fading: float = 0.0

    @classmethod
    def like(cls, window: Window, fading: float) -> DampedWindow:
        """The same part of a record."""
        return cls(window.period, window.periods, window.first, window.lowest, fading)

    @property
    def excited(self) -> NDArray[np.intp]:
        """As many lines as the window has else, of all of them: what fades away is felt beside its own line, too."""
        lines = np.arange(self.periods * self.lowest, (self.samples + 1) // 2)
        return lines[:: -(-len(lines) // len(self.in_period))]

    def points(self, index: NDArray[np.intp]) -> ComplexArray:
        """Lines as points of the circle."""
        return np.exp(self.fading) * super().points(index)

    def excited_lines(self, signal: FloatArray) -> ComplexArray:
        """Lines of the fading signal, at the power of noise that lasts."""
        return self.single_lines(signal, self.excited)

    def single_lines(self, signal: FloatArray, index: NDArray[np.intp]) -> ComplexArray:
        """The same of a few lines."""
        part = self.cut(signal)
        faded = np.exp(-self.fading * np.arange(self.samples)).reshape(-1, *[1] * (part.ndim - 1))
        return np.asarray(rfft(part * faded, axis=0)[index] / np.linalg.norm(faded))
