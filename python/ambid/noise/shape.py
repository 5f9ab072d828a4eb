"""Shapes of noise over frequency that lines are freed from before they are averaged."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.model import Model
from ambid.noise.colour import back_through_loop, loop_noise
from ambid.noise.split import SplitNoise

__all__ = ["Loop", "Recorder", "Shape", "Split", "heard"]


class Shape(Protocol):
    """What is known of noise over frequency, but for what the lines around tell.

    Attributes
    ----------
    numbers : float
        That were fitted for it.
    """

    numbers: float

    def back(self, points: ComplexArray) -> ComplexArray:
        """What makes the noise smooth, shape (points, p, p)."""

    def unsure(self, points: ComplexArray) -> FloatArray:
        """Part by which a covariance is too small in the mean for what was fitted, shape (points,)."""


class Recorder:
    """Noise of the recorder alone, smooth as it is recorded."""

    numbers = 0.0

    def __init__(self, channels: int) -> None:
        self.channels = channels

    def back(self, points: ComplexArray) -> ComplexArray:
        return np.tile(np.eye(self.channels, dtype=complex), (len(points), 1, 1))

    def unsure(self, points: ComplexArray) -> FloatArray:
        return np.zeros(len(points))


class Loop(Recorder):
    """Noise that the controller hears, smooth where it enters."""

    def __init__(self, base: Model, channels: int) -> None:
        super().__init__(channels)
        self.base = base

    def back(self, points: ComplexArray) -> ComplexArray:
        return back_through_loop(self.base, points, self.channels)


def heard(base: Model, channels: int) -> int:
    """Channels whose noise a controller hears, the first ones: those that it reads."""
    return channels if "i_c" in base.rig.controller.signals else min(channels, len(base.rig.axes))


class Split(Recorder):
    """Both at once."""

    def __init__(self, base: Model, channels: int, noise: SplitNoise) -> None:
        super().__init__(channels)
        self.base, self.noise, self.numbers = base, noise, noise.numbers

    def back(self, points: ComplexArray) -> ComplexArray:
        return self.noise.whitening(self._way(points), np.angle(points))

    def unsure(self, points: ComplexArray) -> FloatArray:
        return self.noise.fitted(self._way(points), np.angle(points)) / self.channels

    def shown(self, points: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Power on channels as recorded of noise that is heard, and of noise that is not, shape (points, p) each.

        On y that of what reads y, on i_c that of what reads i_c.
        """
        count, axes, way = self.noise.heard, len(self.base.rig.axes), np.abs(self._way(points)) ** 2
        powers = self.noise.powers(np.angle(points))
        heard = np.zeros((len(points), self.channels))
        for own in (slice(0, axes), slice(axes, count)):
            heard[:, own] = np.einsum("lpc,lc->lp", way[:, own, own], powers[:, :count][:, own])
        return heard, powers[:, count:]

    def _way(self, points: ComplexArray) -> ComplexArray:
        return loop_noise(self.base, points, self.channels)[:, :, : self.noise.heard]
