"""One record on its judged lines: what was measured there, its noise, and how a model is held against it.

A linear model is exact on lines, whatever part of an experiment the record holds: what its states were at the first
sample is the transient d, real numbers that are fitted with every model. A nonlinear one is simulated in time, from a
settled start or, if the record itself begins so, from rest, and transformed; the transient of the model that the noise
is from, linearised at rest, takes up what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.loop.effect import Effect
from ambid.model import Model
from ambid.noise.angles import best_angle
from ambid.noise.chance import SPREAD
from ambid.noise.in_time import NEUTRAL, REMEMBERED
from ambid.noise.shape import Split
from ambid.noise.spectra import NoisyLines
from ambid.noise.transients import OWN, freed, lines_beside_poles, orthonormal, some_lines
from ambid.noise.whitener import whitened


class White(NamedTuple):
    """A whitened record against a model, freed from the transient.

    Attributes
    ----------
    residual : ndarray, shape (numbers,)
        Measured minus simulated.
    slopes : ndarray, shape (numbers, free)
        Derivatives of the response.
    fitted : int
        How many numbers of the transient the lines determine.
    transients : ndarray, shape (numbers, states)
        An orthonormal basis of what a transient can look like; of a linear model only where derivatives are asked for.
    """

    residual: FloatArray
    slopes: FloatArray
    fitted: int
    transients: FloatArray


class RecordLines(NoisyLines):
    """The same, against any model: the noise stays the same for all models after.

    See `NoisyLines` for parameters and attributes.
    """

    is_in_time: Literal[True] = True
    scatter = SPREAD

    @cached_property
    def _data(self) -> dict[tuple[Effect, ...], _core.LineData]:
        """By the disturbances that drive a model."""
        return {}

    @cached_property
    def _transients(self) -> dict[tuple[_core.ClosedLoop, bytes], tuple[FloatArray, int]]:
        return {}

    def with_own_angles(self, model: Model) -> RecordLines:
        """The same, with the angle of every wave of the model where it fits best."""
        best = self
        for effect in model.acting:
            if effect.quarters(model.rig):
                best = best.with_angle(effect, best_angle(partial(best._cost_at, model, effect)))
        return best

    def where_noise_arises(self, model: Model) -> RecordLines:
        """The same, with the shape of noise that makes the unexcited lines likeliest."""
        if not self.window.is_periodic:
            return self
        unexcited, split = self.unexcited.with_likeliest_shape(self.tones)
        own = self
        if unexcited is not self.unexcited:
            own = RecordLines(model, self.measured, self.tones, angles=self.angles, unexcited=unexcited)
        own.split = split
        return own

    def __copy__(self) -> RecordLines:
        """With what is known of compiled loops."""
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __getstate__(self) -> dict[str, Any]:
        """All but that."""
        return {**self.__dict__, "_data": {}, "_transients": {}}

    split: Split | None = None
    """Where the noise arises, if that is known."""

    def _cost_at(self, model: Model, effect: Effect, angle: float) -> float:
        own = self.with_angle(effect, angle)
        return float(np.sum(own.white(own.at(model), []).residual ** 2))

    def with_angle(self, effect: Effect, angle: float) -> RecordLines:
        """The same with another angle of the waves of one effect [rad]."""
        other = copy(self)
        other.angles = self.angles | {effect.name: angle}
        return other

    def by_channel(self, white: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Excited lines [Hz], and the power of whitened numbers in each channel over its noise, shape (lines, p)."""
        count = len(self.window.excited)
        lines = as_lines(white, self.measured.channels)[:count, :, None]
        back = (_core.inverses(self.whitening)[:count] @ lines)[..., 0]
        return self.frequency_hz, np.asarray(np.abs(back) ** 2 / self.noise_power()[:count])

    @property
    def excitations(self) -> tuple[tuple[str, ...], ComplexArray]:
        """Each axis of i_e and r that moves: its name, and its excited lines, shape (lines, inputs)."""
        moves = np.any(self._driven, axis=0)
        names = (name for name, is_moving in zip(self._base.loop.inputs, moves, strict=False) if is_moving)
        return tuple(names), self._driven[: len(self.window.excited), moves]

    def by_line(self, rows: FloatArray) -> FloatArray:
        """Rows of whitened numbers, summed line by line."""
        return np.asarray(rows.reshape(len(self.index), -1, rows.shape[1]).sum(axis=1))

    def on_tones(self, here: Model) -> tuple[float, int]:
        """J on the lines that are judged beside the excited ones, and how many numbers the waves there are."""
        if not len(self.more):
            return 0.0, 0
        by_line = self.by_line(self.white(here, []).residual[:, None] ** 2)
        waves = 1 + int(np.sum(np.diff(self.more) > 1))
        return float(by_line[-len(self.more) :].sum()), 2 * self.measured.channels * waves

    def data(self, here: Model) -> _core.LineData:
        """The lines for the core, with the inputs that a model at this operating point has."""
        drives = tuple(here.acting) if here.loop.core.inputs > here.loop.driven else ()
        if drives not in self._data:
            inputs, whitening = self._inputs(here), self.whitening
            self._data[drives] = _core.LineData(here.loop.core, self.points, inputs, self.measured_lines, whitening)
        return self._data[drives]

    def transient(self, here: Model) -> tuple[FloatArray, int]:
        """The best transient of a linear model, and how many numbers of it the lines determine."""
        key = (here.loop.core, here.theta.tobytes())
        if key not in self._transients:
            *_, transients, _, fitted = _core.line_equations(here.loop.core, here.theta, [], [self.data(here)])
            self.remember(here, transients[0], fitted[0])
        return self._transients[key]

    def known_transient(self, here: Model) -> FloatArray | None:
        """The best transient, if it was found before."""
        found = self._transients.get((here.loop.core, here.theta.tobytes()))
        return None if found is None else found[0]

    def remember(self, here: Model, transient: FloatArray, fitted: int) -> None:
        """Keep a transient that was found along the way, and the last few before it."""
        self._transients[here.loop.core, here.theta.tobytes()] = (transient, fitted)
        while len(self._transients) > REMEMBERED:
            self._transients.pop(next(iter(self._transients)))

    def white(self, here: Model, free: Sequence[int], *, roughly: bool = False, shortly: bool = False) -> White:
        """Residual at the best transient, and derivatives by the parameters in `free`, both freed from the transient.

        Parameters
        ----------
        here : Model
            At this operating point.
        free : sequence of int
        roughly : bool
            Of a nonlinear model take the derivatives by all but its nonlinear effects' parameters from the model
            without those, where that is stable: nearly parallel to the exact ones, several times as fast. Derivatives
            by errors of values that are known to a tolerance are taken so in any case.
        shortly : bool
            Take a settled response after a short lead: near enough to lead a descent.
        """
        core, theta, own = here.loop.core, here.theta, list(free)
        if here.is_linear:
            transient, fitted = self.transient(here)
            rows = self.data(here).rows(core, theta, own, transient, bool(own))
            basis, slopes, residual = np.split(rows, [rows.shape[1] - 1 - len(own), rows.shape[1] - 1], axis=1)
            basis = orthonormal(basis)
            return White(-residual[:, 0], freed(slopes, basis), fitted, basis)
        linear = here.without_nonlinear()
        is_near = bool(own) and linear.is_stable
        shared = [k for k, i in enumerate(own) if is_near and self._is_near_enough(here, linear, i, roughly=roughly)]
        exact = [k for k in range(len(own)) if k not in shared]
        response, derivatives = self._simulated(here, [own[k] for k in exact], shortly=shortly)
        basis, left = self._own_transients, self.whiten(self.measured_lines - response)
        columns = np.empty((len(left), len(own)))
        if exact:
            columns[:, exact] = self.whiten(derivatives)
        if shared:
            columns[:, shared] = self.slopes(linear, [linear.names.index(here.names[own[k]]) for k in shared])
        return White(freed(left, basis), freed(columns, basis), basis.shape[1], basis)

    @staticmethod
    def _is_near_enough(here: Model, linear: Model, i: int, *, roughly: bool) -> bool:
        """Whether the derivative by a parameter may be that of the linear part: of an error that is small, always."""
        own = here.parameters[i]
        return own.name in linear.names and (roughly or own.prior is not None)

    def slopes(self, here: Model, free: Sequence[int]) -> FloatArray:
        """Whitened derivatives of the settled response by the parameters in `free`, shape (numbers, free)."""
        if not here.is_linear:
            return self.whiten(self._in_time.lines(here, list(free), at_rest=False)[1])
        return self.data(here).rows(here.loop.core, here.theta, list(free), None, False)[:, :-1]

    def transients(self, here: Model) -> FloatArray:
        """An orthonormal basis of what a transient can look like, whitened, shape (numbers, states)."""
        if not here.is_linear:
            return self._own_transients
        return orthonormal(self.data(here).rows(here.loop.core, here.theta, [], None, True)[:, :-1])

    def departure(self, here: Model) -> FloatArray:
        """Whitened response of a settled model less what was measured; of two models the difference is one of both."""
        if here.is_linear:
            return self.data(here).rows(here.loop.core, here.theta, [], None, False)[:, 0]
        return self.whiten(self._in_time.nearly(here, [])[0] - self.measured_lines)

    def departure_from_rest(self, here: Model, free: Sequence[int] = ()) -> tuple[FloatArray, FloatArray]:
        """The same of a linear model that rests when the record begins, and its derivatives."""
        response, slopes = self._in_time.from_rest(here, list(free))
        return self.whiten(response - self.measured_lines), self.whiten(slopes)

    def residual_lines(self, here: Model) -> ComplexArray:
        """Residual on the judged lines at the best transient, not whitened, shape (lines, p)."""
        core, p = here.loop.core, self.measured.channels
        if not here.is_linear:
            lines, basis = self._simulated(here, [])[0], self._basis
            left = self.measured_lines - lines
            white, columns = self.whiten(left), self.whiten(basis)
            d = np.linalg.lstsq(columns, white, rcond=np.sqrt(OWN))[0]
            return np.asarray(left - basis @ d)
        transient, _ = self.transient(here)
        found, _, _ = core.lines(here.theta, [], self.points, self._inputs(here), transient, False)
        return self.measured_lines - found[:, :p]

    def simulated(self, here: Model) -> FloatArray:
        """Response in time with the best transient, shape (samples, p), of all samples of the record.

        Beyond the last whole period it goes on with the excitation, but is not known (NaN) where what disturbs the loop
        need not repeat.
        """
        window, p, core = self.window, self.measured.channels, here.loop.core
        samples = self.record.samples
        if not here.is_linear:
            return self._simulated_in_time(here)
        transient = self._transient_in_time(here)
        y, until = np.zeros((samples, p)), samples
        if here.decay_rate > NEUTRAL:
            # part of a transient that is left where it is nothing beside what it was
            until = int(min(samples, np.ceil(-np.log(1e-16) / here.decay_rate * self.record.sample_rate)))
        y[:until] = core.free_response(here.theta, transient, window.samples, until)[:, :p]
        inputs = here.excitation(self.record)[: window.samples]
        repeats = core.inputs == here.loop.driven
        length = window.period if repeats else window.samples
        u = np.ascontiguousarray(rfft(inputs.reshape(-1, length, core.inputs).mean(axis=0), axis=0))
        points = np.exp(2j * np.pi * np.arange(length // 2 + 1) / length)
        lines, _, _ = core.lines(here.theta, [], points, u, None, False)
        if not repeats:
            y[window.samples :] = np.nan
        for k in range(p):  # one by one: of a long record without periods all are large
            steady = irfft(lines[:, k], n=length)
            y[:, k] += np.resize(steady, samples) if repeats else np.pad(steady, (0, samples - length))
        return np.asarray(y)

    def _transient_in_time(self, here: Model) -> FloatArray:
        """The best transient of a linear model by the judged lines and those beside its slow poles."""
        more = lines_beside_poles(here, self.window, self.record.sample_rate, self.tones)
        if not len(more):
            return self.transient(here)[0]
        core, index = here.loop.core, np.concatenate([self.index, more])
        z = np.concatenate(
            [self.measured_lines, np.hstack([some_lines(self.window, part, more) for part in self.record.parts])]
        )
        excitation = np.ascontiguousarray(here.excitation(self.record))
        inputs = np.concatenate([self._inputs(here), some_lines(self.window, excitation, more)])
        data = _core.LineData(core, self.window.points(index), inputs, z, self._whitening_with(more))
        return np.asarray(_core.line_equations(core, here.theta, [], [data])[3][0])

    def _whitening_with(self, more: NDArray[np.intp]) -> ComplexArray:
        """That of the judged lines, then of others, each that of the excited line beside it."""
        beside = np.minimum(np.searchsorted(self.window.excited, more), len(self.window.excited) - 1)
        return np.concatenate([self.whitening, self.whitening[beside]])

    def _simulated_in_time(self, here: Model) -> FloatArray:
        """The same of a nonlinear model."""
        window, p, base = self.window, self.measured.channels, self._base
        self._simulated(here, [])  # decides whether it starts at rest
        steady = self._in_time.samples(here, at_rest=bool(self._starts_at_rest))
        more = lines_beside_poles(base, window, self.record.sample_rate, self.tones)
        index = np.concatenate([self.index, more])
        left = np.concatenate(
            [self.judged_lines(self.record.outputs - steady), some_lines(window, self.record.outputs - steady, more)]
        )
        nothing = np.zeros((len(index), base.loop.core.inputs), dtype=complex)
        basis = base.loop.core.lines(base.theta, [], window.points(index), nothing)[2][:, :p]
        white, columns = (whitened(self._whitening_with(more), lines) for lines in (left, basis))
        d = np.asarray(np.linalg.lstsq(columns, white, rcond=np.sqrt(OWN))[0])
        free = base.loop.core.free_response(base.theta, d, window.samples, self.record.samples)[:, :p]
        return np.asarray(steady + free)

    @cached_property
    def _basis(self) -> ComplexArray:
        """What each number of a transient of the noise's own model adds on the judged lines, (lines, p, states)."""
        core = self._base.loop.core
        nothing = np.zeros((len(self.points), core.inputs), dtype=complex)
        return core.lines(self._base.theta, [], self.points, nothing)[2][:, : self.measured.channels]

    @cached_property
    def _own_transients(self) -> FloatArray:
        return orthonormal(self.whiten(self._basis))

    def _simulated(self, here: Model, free: list[int], *, shortly: bool = False) -> tuple[ComplexArray, ComplexArray]:
        """Judged lines of a nonlinear model's response and of its derivatives, simulated in time."""
        if self._starts_at_rest is None:
            self._starts_at_rest = self._begins_at_rest(here)
        if shortly and not self._starts_at_rest:
            return self._in_time.nearly(here, free)
        return self._in_time.lines(here, free, at_rest=self._starts_at_rest)

    _starts_at_rest: bool | None = None

    def _begins_at_rest(self, here: Model) -> bool:
        """Whether the record is nearer to a response from rest than to a settled one."""
        if not self.window.is_periodic:
            return True
        responses = self._in_time.nearly(here, [])[0], self._in_time.lines(here, [], at_rest=True)[0]
        settled, from_rest = (
            float(np.linalg.norm(self.whiten(self.measured_lines - response))) for response in responses
        )
        return from_rest < settled


def as_lines(white: FloatArray, p: int) -> ComplexArray:
    """Whitened numbers, shape (numbers, ...), as complex lines, shape (lines, p, ...)."""
    pairs = white.reshape(len(white) // (2 * p), p, 2, *white.shape[1:])
    return np.asarray(pairs[:, :, 0] + 1j * pairs[:, :, 1])
