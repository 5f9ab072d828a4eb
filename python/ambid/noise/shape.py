"""Shapes of noise over frequency, which lines are freed from before they are averaged."""

from typing import Protocol

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.model import Model
from ambid.noise.colour import back_through_loop, inputs_of_noise, loop_noise
from ambid.noise.split import ROUGHLY, SplitNoise


def heard(base: Model, channels: int) -> int:
    """Channels whose noise a controller hears, the first ones: those that it reads."""
    return len(inputs_of_noise(base, channels)[1])


class Shape(Protocol):
    """What is known of noise over frequency, but for what the lines around show.

    Attributes
    ----------
    numbers : float
        That were fitted for it.
    """

    numbers: float

    def back(self, points: ComplexArray) -> ComplexArray:
        """What makes the noise on lines smooth over frequency, shape (points, p, p)."""

    def unsure(self, points: ComplexArray) -> FloatArray:
        """Part by which a covariance is too small in the mean for what was fitted, shape (points,)."""


class Recorder:
    """Noise of the recorder alone, smooth as it is recorded."""

    numbers = 0.0

    def __init__(self, channels: int) -> None:
        self.channels = channels

    def back(self, points: ComplexArray) -> ComplexArray:
        """One on every line."""
        return np.tile(np.eye(self.channels, dtype=complex), (len(points), 1, 1))

    def unsure(self, points: ComplexArray) -> FloatArray:
        """Nothing was fitted."""
        return np.zeros(len(points))


class Loop(Recorder):
    """Noise that the controller hears, smooth where it enters."""

    def __init__(self, base: Model, channels: int) -> None:
        super().__init__(channels)
        self.base = base

    def back(self, points: ComplexArray) -> ComplexArray:
        """The way back through the loop."""
        return back_through_loop(self.base, points, self.channels)


class Split:
    """Noise that the controller hears and noise of the recorder at once, all of them white on every line."""

    def __init__(self, base: Model, channels: int, noise: SplitNoise) -> None:
        self.base, self.channels, self.noise, self.numbers = base, channels, noise, noise.numbers

    def back(self, points: ComplexArray) -> ComplexArray:
        """Inverse of the Cholesky factor of the covariance."""
        return self.noise.whitening(self._way(points), np.angle(points))

    def unsure(self, points: ComplexArray) -> FloatArray:
        """By the numbers of the curves, straight between some of the points."""
        angle = np.angle(points)
        some = np.argsort(angle)[:: 1 + len(angle) // ROUGHLY]
        own = self.noise.fitted(self._way(points[some]), angle[some]) / self.channels
        return np.interp(angle, angle[some], own)

    def shown(self, points: ComplexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Power of noise that is heard, that is not, and that may be either, shape (points, heard) each.

        As recorded of the channels that are read: on y that of what reads y, on i_c that of what reads i_c.
        """
        count, axes, way, angle = self.noise.heard, len(self.base.rig.axes), self._way(points), np.angle(points)
        powers, separable = self.noise.powers(angle), self.noise.separable(way, angle)
        of_loop, recorder = np.zeros((len(points), count)), powers[:, count : 2 * count]
        for own in (slice(0, axes), slice(axes, count)):
            of_loop[:, own] = np.einsum("lpc,lc->lp", np.abs(way[:, own, own]) ** 2, powers[:, :count][:, own])
        return separable * of_loop, separable * recorder, np.where(separable, 0.0, of_loop + recorder)

    def _way(self, points: ComplexArray) -> ComplexArray:
        return loop_noise(self.base, points, self.channels)[:, :, : self.noise.heard]
