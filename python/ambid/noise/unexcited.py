"""What a model leaves of the lines that are not excited: noise, and what has a frequency of its own."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ambid import _core
from ambid.arrays import ComplexArray
from ambid.errors import ModelError
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.colour import loop_noise
from ambid.noise.measured import Measured
from ambid.noise.shape import Loop, Recorder, Shape, Split, heard
from ambid.noise.split import ROUGHLY, SplitNoise
from ambid.noise.transients import orthonormal
from ambid.noise.wave import NEAR, OUTSTANDING, waves_between
from ambid.noise.whitener import HALF_WIDTH, PER_CHANNEL, Around, around, likelier_shape

LEFT = 0.2
"""Part of a line's noise that counts as left beside the transient, at the least."""
ENOUGH = 2000
"""Unexcited lines that determine a transient well enough to take it out of the noise."""
SEVERAL, AROUND = 4, 60
"""Lines between two excited ones, and excited ones to each side, that give the noise in the measurement of i_e; no loop
shapes it."""
SHAPED = 3000
"""Unexcited lines that determine the shape of the noise."""


class _Shaped(NamedTuple):
    """Some lines behind a shape, what took them there, and how they give the noise between them."""

    back: ComplexArray
    left: ComplexArray
    around: Around


class Unexcited:
    """The unexcited lines of the settled periods of a record, behind the loop of a model.

    Parameters
    ----------
    base : Model
        At the operating point of the record.
    measured : Measured

    Attributes
    ----------
    shape : Shape
        Of their noise; at first as if all of it were heard by the controller.
    """

    def __init__(self, base: Model, measured: Measured) -> None:
        self.base, self.measured, self.window = base, measured, measured.window.settled
        self.shape: Shape = Loop(base, measured.channels)
        self._kept: dict[tuple[Tone, ...], _Shaped] = {}

    def __copy__(self) -> Unexcited:
        """With what is known of them."""
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __getstate__(self) -> dict[str, Any]:
        """All but that, which is found again."""
        return {**self.__dict__, "_kept": {}}

    def left(self, index: NDArray[np.intp], tones: Sequence[Tone] = ()) -> ComplexArray:
        """What model and tones leave of unexcited lines of the settled periods, behind their shape, (lines, p).

        Of few lines the transient takes part of the noise with it, most of the lowest one: they are raised to what they
        would hold without.
        """
        return self._left(index, tones, self.back(self.window.points(index)), is_heard=self.is_heard)

    def back(self, points: ComplexArray) -> ComplexArray:
        """What makes noise smooth over frequency, shape (points, p, p)."""
        return self.shape.back(points)

    def around(self, tones: Sequence[Tone] = ()) -> Around:
        """How the lines without tones give the noise between them."""
        return self._shaped(self._between(), tones).around

    def with_likeliest_shape(self, tones: Sequence[Tone] = ()) -> tuple[Unexcited, Split | None]:
        """The same lines with what makes them likeliest, each by those around it, and where their noise arises."""
        index = self._between()
        index = index[:: 1 + len(index) // SHAPED]
        tried, split = [self, self._with(Recorder(self.measured.channels))], None
        shaped = [own._shaped(index, tones) for own in tried]
        if self.base.is_stable and heard(self.base, self.measured.channels):
            with suppress(ModelError):  # no noise on some channel
                split = self._split(index, shaped[0].left, tones)
                other = self._with(split)
                shaped.append(other._shaped(index, tones))
                tried.append(other)
        numbers = [own.shape.numbers for own in tried]
        best = likelier_shape([own.around for own in shaped], [own.back for own in shaped], numbers)
        return tried[best], split

    def _with(self, shape: Shape) -> Unexcited:
        """The same lines behind another shape."""
        other = copy(self)
        other.shape, other._kept = shape, {}
        return other

    def _between(self) -> NDArray[np.intp]:
        return self.window.between(self.gap)

    def _shaped(self, index: NDArray[np.intp], tones: Sequence[Tone]) -> _Shaped:
        """What some of the lines show; of few, that give the noise and its shape, it is kept until asked for again."""
        key = tuple(tones)
        is_kept = len(index) < SHAPED and len(index) == len(self._between())
        if is_kept and key in self._kept:
            return self._kept.pop(key)
        back = self.back(self.window.points(index))
        left = self._left(index, tones, back, is_heard=self.is_heard)
        found = _Shaped(back, left, around(left, index / self.window.periods))
        if is_kept:
            self._kept[key] = found
        return found

    def _split(self, index: NDArray[np.intp], behind: ComplexArray, tones: Sequence[Tone]) -> Split:
        """Noise that is heard and noise that is not, by lines behind the loop."""
        points, p = self.window.points(index), self.measured.channels
        angle, way = np.angle(points), loop_noise(self.base, points, p)
        own = way[:, :, : heard(self.base, p)]
        rough = SplitNoise(_core.through(way, behind), own, angle, ROUGHLY).whitening(own, angle)
        left = self._left(index, tones, rough, is_heard=self.is_heard)  # less the transient estimated in such noise
        return Split(self.base, p, SplitNoise(_core.through(_core.inverses(rough), left), own, angle))

    @property
    def gap(self) -> int:
        """Lines between two excited ones that give the noise."""
        return max(2, -(-PER_CHANNEL * self.measured.channels // (2 * HALF_WIDTH)))

    @cached_property
    def is_heard(self) -> bool:
        """Whether what i_e holds beside its period drives the loop; else it was measured with noise.

        Taken for excitation, noise of its measurement makes what the model leaves louder. So does the noise of an i_e
        that was rebuilt; it is that of i_c once more, and counted twice, which errs to the safe side.
        """
        if not self._varies:
            return True
        some = self.window.between(1)
        back = Loop(self.base, self.measured.channels).back(self.window.points(some))
        powers = (np.abs(self._left(some, (), back, is_heard=own)) for own in (True, False))
        heard, unheard = (np.mean(np.log(power + np.finfo(float).tiny)) for power in powers)
        return bool(heard <= unheard)

    def unheard(self, judged: NDArray[np.intp]) -> ComplexArray | None:
        """Power that noise in the measurement of i_e adds to judged lines of it, shape (lines, axes, axes), if any.

        Parameters
        ----------
        judged : ndarray of int
            Lines of all periods.
        """
        if self.is_heard:
            return None
        index = self.window.between(SEVERAL)
        lines = self._inputs(index)[:, : self._axes]
        scatter = lines[:, :, None] * lines[:, None, :].conj()
        power = uniform_filter1d(scatter, min(2 * AROUND * SEVERAL + 1, len(index)), axis=0, mode="reflect")
        nearest = np.searchsorted(index / self.window.periods, judged / self.measured.window.periods)
        return np.asarray(power[np.minimum(nearest, len(index) - 1)])

    @property
    def _axes(self) -> int:
        return len(self.measured.record.axes)

    @cached_property
    def _varies(self) -> bool:
        """Whether i_e repeats but for noise."""
        part = self.window.cut(self.base.excitation(self.measured.record)[:, : self._axes])
        part = part.reshape(self.window.periods, -1)
        return bool((part != part[0]).any())

    def _left(
        self, index: NDArray[np.intp], tones: Sequence[Tone], back: ComplexArray, *, is_heard: bool
    ) -> ComplexArray:
        """The same by some way back, with or without a response to what i_e holds beside its period."""
        window, p = self.window, self.measured.channels
        # what a weak one spills is less than what fitting it to noise would
        loud = [tone.frequency_hz for tone in tones if tone.power > OUTSTANDING]
        here, places = self._silenced(loud), [f * window.samples / self.measured.record.sample_rate for f in loud]
        points, z = window.points(index), np.ascontiguousarray(self.measured.quiet[index])
        z = z - waves_between(self.measured.quiet, window, places, index)
        size = np.sqrt(np.median(np.abs(_core.through(back, z)) ** 2, axis=0))
        size[size == 0.0] = 1.0
        core, inputs = here.loop.core, self._inputs(index)
        if not is_heard:
            inputs[:, : self._axes] = 0.0
        few = np.arange(0, len(index), 1 + len(index) // ENOUGH)
        chosen = _core.LineData(core, points[few], inputs[few], z[few], back[few] / size[:, None])
        *_, transients, _, _ = _core.line_equations(core, here.theta, [], [chosen])
        response, _, _ = core.lines(here.theta, [], points, inputs, transients[0], False)
        left = _core.through(back, z - response[:, :p])
        if len(few) < len(index):
            return left
        basis = orthonormal(chosen.rows(core, here.theta, [], None, True)[:, :-1])
        taken = np.sum(basis**2, axis=1).reshape(-1, p, 2).mean(axis=2)
        return np.asarray(left / np.sqrt(np.maximum(1.0 - taken, LEFT)))

    def _silenced(self, loud: Sequence[float]) -> Model:
        """The base model without waves of its effects at these frequencies [Hz].

        Beside a loud tone a wave of the model, such as that of an unbalance, is off, maybe by far.
        """
        here, near = self.base, NEAR * self.measured.record.sample_rate / self.window.samples
        off = [
            effect
            for effect in here.acting
            if any(abs(own - tone) < near for own in effect.frequencies_hz(here.rig) for tone in loud)
        ]
        waves = (effect.slot(name) for effect in off for pair in effect.quarters(here.rig) for name in pair)
        return here.with_values(dict.fromkeys(waves, 0.0)) if off else here

    def _inputs(self, index: NDArray[np.intp]) -> ComplexArray:
        """Inputs on unexcited lines of the settled periods; nothing where they repeat to the last bit."""
        window, inputs = self.window, self.base.excitation(self.measured.record)
        part = window.cut(inputs).reshape(window.periods, -1)
        if (part == part[0]).all():
            return np.zeros((len(index), inputs.shape[1]), dtype=complex)
        return np.ascontiguousarray(window.lines(inputs)[index])
