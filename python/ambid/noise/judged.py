"""The lines of a record that are judged: what was measured on them, what drives them, and which tones stand there."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ComplexArray, FloatArray
from ambid.loop.controller import of_reference
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.angles import turned
from ambid.noise.in_time import NEUTRAL
from ambid.noise.measured import Measured
from ambid.noise.wave import NEAR, waves_between

FEW = 400
"""Lines that lead a fit near its optimum."""


class JudgedLines:
    """The lines of a record that are judged, whatever the noise on them.

    Parameters
    ----------
    model : Model
        Its loop shapes the noise.
    measured : Measured
    tones : sequence of Tone
        The lines around them, and around the frequencies of effects in the model, are judged beside the excited ones.
    rough : bool
        Few lines.
    angles : mapping of str to float
        By which waves of effects, by name, are turned in this record [rad].

    Attributes
    ----------
    index : ndarray of int
        Judged lines: the excited ones, then others.
    more : ndarray of int
        The others.
    points : ndarray of complex
        The judged lines as points of the unit circle.
    measured_lines : ndarray of complex, shape (lines, p)
        What was measured on them.
    """

    def __init__(
        self, model: Model, measured: Measured, tones: Sequence[Tone], *, rough: bool, angles: Mapping[str, float]
    ) -> None:
        self.measured, self.record, self.window = measured, measured.record, measured.window
        self.tones = tuple(tones)
        self.angles = dict(angles)
        self._base = here = _shaping(self.at(model))
        own = [f for effect in here.acting for f in effect.frequencies_hz(here.rig)]
        self.more = self._around([*own, *(tone.frequency_hz for tone in tones)])
        self._every = max(1, len(self.window.excited) // FEW) if rough else 1
        self.index = np.concatenate([self.window.excited, self.more])[:: self._every]
        self.points = self.window.points(self.index)
        self.measured_lines = self._some(measured.excited, measured.single)

    @property
    def frequency_hz(self) -> FloatArray:
        """The excited lines [Hz]."""
        return np.asarray(self.window.excited * self.record.sample_rate / self.window.samples)

    def at(self, model: Model) -> Model:
        """The model at the operating point of the record, with its own angles where they are known."""
        here = model.at(self.record)
        return turned(here, self.angles) if self.angles else here

    def _inputs(self, here: Model) -> ComplexArray:
        """Inputs on the judged lines: i_e and r, then those of disturbances in the model."""
        if here.loop.core.inputs == here.loop.driven:
            return self._driven
        return self.judged_lines(here.excitation(self.record))

    @cached_property
    def _driven(self) -> ComplexArray:
        """i_e and r on the judged lines."""
        return self.judged_lines(self._base.excitation(self.record)[:, : self._base.loop.driven])

    @cached_property
    def drive(self) -> ComplexArray:
        """What drives each axis that is not still, as one excitation: r acts by way of the controller."""
        return self._as_one(self._driven, self.points)

    def _as_one(self, driven: ComplexArray, points: ComplexArray) -> ComplexArray:
        """The same of i_e and r on other lines."""
        i_e, r = np.split(driven, [len(self.record.axes)], axis=1)
        both = i_e if r.shape[1] == 0 else r
        if i_e.any() and r.any():
            both = i_e + (of_reference(self._base.rig, points) @ r[..., None])[..., 0]
        elif i_e.any():
            both = i_e
        return both[:, np.any(both, axis=0)]

    @property
    def loudest(self) -> int:
        """Which of the judged lines holds most of the excitation."""
        return int(np.argmax(np.sum(np.abs(self.drive) ** 2, axis=1)))

    @property
    def lines_driven(self) -> float:
        """How many lines share the power of the excitation: so many, if all of them had as much of it."""
        power = np.sum(np.abs(self.drive) ** 2, axis=1)
        return float(power.sum() ** 2 / max(float(power @ power), 1e-300))

    def judged_lines(self, signal: FloatArray) -> ComplexArray:
        """The judged lines of a signal that starts with the record."""
        return self._some(self.window.excited_lines(signal), lambda index: self.window.single_lines(signal, index))

    def lines_of_period(self, folded: FloatArray) -> ComplexArray:
        """The same of a signal that repeats, from its sum over the periods: nothing stands between excited lines."""
        return self._some(
            self.window.of_period(folded), lambda index: np.zeros((len(index), *folded.shape[1:]), dtype=complex)
        )

    def _some(self, excited: ComplexArray, single: Callable[[NDArray[np.intp]], ComplexArray]) -> ComplexArray:
        """Those that are judged of the excited lines, and of others, which are given one by one."""
        lines = np.concatenate([excited, single(self.more)]) if len(self.more) else excited
        return np.ascontiguousarray(lines[:: self._every])

    def _without_tones(self, left: ComplexArray) -> ComplexArray:
        """Judged lines less the waves of the tones that all lines around are judged of."""
        places = np.array([tone.frequency_hz for tone in self.tones]) * self.window.samples / self.record.sample_rate
        near = np.maximum(1, np.round(places)[:, None] + np.arange(-NEAR, NEAR + 1))
        places = places[np.isin(near, self.index).all(axis=1)]
        lines = np.zeros((self.window.samples // 2 + 1, left.shape[1]), dtype=complex)
        lines[self.index] = left
        return left - waves_between(lines, self.window, places.tolist(), self.index)

    @property
    def beside_tones(self) -> NDArray[np.bool_]:
        """Which of the judged lines are not near a tone."""
        places = np.array([tone.frequency_hz for tone in self.tones]) * self.window.samples / self.record.sample_rate
        return np.asarray((np.abs(self.index[:, None] - places) > NEAR).all(axis=1))

    def _around(self, frequencies_hz: Sequence[float]) -> NDArray[np.intp]:
        """The unexcited lines next to frequencies."""
        window = self.window
        at = [frequency * window.samples / self.record.sample_rate for frequency in frequencies_hz]
        near = {line for place in at for line in range(int(place) - 1, int(place) + 3)}
        inside = (line for line in near if 0 < line < window.samples // 2 and line % window.periods)
        return np.array(sorted(inside) if window.is_periodic else [], dtype=np.intp)


def _shaping(here: Model) -> Model:
    """What shapes the noise of a model: itself, or, where its nonlinear effects make rest neutral, what it is else."""
    return here if here.is_linear or here.decay_rate > NEUTRAL else here.without_nonlinear()
