"""The one yardstick: noise of y and i_c of several records, and whitened lines whose sum of squares is J."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ambid import _core
from ambid.arrays import FloatArray, is_same
from ambid.errors import UnstableLoopError
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.in_time import REMEMBERED
from ambid.noise.known import BANDS, Size, known_residual, known_slopes
from ambid.noise.lines import RecordLines, White
from ambid.noise.measured import Measured
from ambid.noise.response_lines import ResponseLines
from ambid.noise.tones import confirmed, find_tones, misses_tone
from ambid.record import Measurement

Part = RecordLines | ResponseLines
OnLines = dict[_core.ClosedLoop, list[tuple[int, RecordLines, _core.LineData]]]
_Known = tuple[object, tuple[int, ...], tuple[bool, bool]]
"""A model, its free parameters, and whether the form is found roughly, and shortly."""


@dataclass(frozen=True)
class Quadratic:
    """J as a quadratic form about a model, at the best transient of every record.

    Attributes
    ----------
    hessian : ndarray, shape (free, free)
        J'J of the whitened residual.
    gradient : ndarray, shape (free,)
        J'r, r being simulated minus measured.
    cost : float
        J.
    fitted : int
        Numbers of the transients that the lines determine; so many degrees of freedom are theirs.
    transients : list of ndarray
        Of each record; empty for a nonlinear model.
    transient_slopes : list of ndarray
        How they change with the parameters, shape (free, numbers of the transient).
    """

    hessian: FloatArray
    gradient: FloatArray
    cost: float
    fitted: int
    transients: list[FloatArray]
    transient_slopes: list[FloatArray]


class Noise:
    """Noise of y and i_c of several records; the same for all models after.

    Tones of the residual are no noise: the lines around them are judged beside the excited ones.

    Parameters
    ----------
    model : Model
        Its loop shapes the noise, and its transient is no noise.
    records : sequence of Record or FrequencyResponse

    Attributes
    ----------
    records : tuple of Record or FrequencyResponse
    parts : tuple of RecordLines or ResponseLines
        One per record.
    lines : int
        Number of real numbers that were measured and are judged: 2 p per line, summed over the records.
    """

    def __init__(self, model: Model, records: Sequence[Measurement]) -> None:
        self._take([_part(model, record) for record in records])

    def _take(self, parts: Sequence[Part]) -> None:
        self.parts = tuple(parts)
        self.records = tuple(part.record for part in parts)
        self.lines = sum(part.judged for part in parts)
        self._known: dict[_Known, Quadratic] = {}

    @classmethod
    def rough(cls, model: Model, records: Sequence[Measurement], damping: float = 0.0) -> Noise:
        """A rough one of few lines, to come near an optimum with; of samples that fade away at a rate [1/s], if any."""
        return cls.of_parts([_part(model, record, damping, is_rough=True) for record in records])

    @classmethod
    def of_parts(cls, parts: Sequence[Part]) -> Noise:
        """The noise of records whose lines are there already."""
        other = cls.__new__(cls)
        other._take(parts)
        return other

    def __eq__(self, other: object) -> bool:
        """Whether the same lines are whitened alike."""
        if not isinstance(other, Noise):
            return NotImplemented
        own, its = (
            [(part.angles, part.tones, part.measured_lines, part.whitening) for part in noise.parts]
            for noise in (self, other)
        )
        return is_same(own, its)

    def __hash__(self) -> int:
        return hash((self.lines, len(self.parts)))

    def __getstate__(self) -> dict[str, Any]:
        """All but what is known of compiled loops."""
        return {**self.__dict__, "_known": {}}

    def renewed(self, model: Model) -> Noise:
        """The noise of the same records by the residual of another model, with the angles that are known."""
        return Noise.of_parts(
            [
                _judged(model, part.measured, part.angles) if part.is_in_time else _part(model, part.record)
                for part in self.parts
            ]
        )

    def with_own_angles(self, model: Model) -> Noise:
        """The same noise, with the angle of every wave of a model where it fits each record best."""
        return Noise.of_parts([part.with_own_angles(model) for part in self.parts])

    @property
    def in_time(self) -> tuple[RecordLines, ...]:
        """The parts that are of records in time."""
        return tuple(part for part in self.parts if part.is_in_time)

    @property
    def tones(self) -> list[tuple[Tone, ...]]:
        """Tones of each record."""
        return [part.tones for part in self.parts]

    def misses_tone(self, model: Model) -> bool:
        """Whether a model shows a tone that the one this noise is from did not; it is to be renewed then."""
        return any(misses_tone(model, part) for part in self.in_time)

    @property
    def spreads(self) -> FloatArray:
        """Variance of each whitened number of the records on the direction of a whitened response, see `Spectrum`."""
        return np.concatenate([part.spreads for part in self.parts])

    @property
    def scatter(self) -> float:
        """Standard deviation of the J of a right model, in units of sqrt(2 dof)."""
        numbers = [part.judged for part in self.parts]
        return float(np.sqrt(np.average([part.scatter**2 for part in self.parts], weights=numbers)))

    def by_record(self, white: FloatArray) -> list[FloatArray]:
        """Whitened numbers of all records, record by record, without those that are known beforehand."""
        return np.split(white, np.cumsum([part.numbers for part in self.parts]))[:-1]

    def freed(self, white: FloatArray, transients: Sequence[FloatArray]) -> FloatArray:
        """What transients, see `transients`, cannot take over of whitened numbers, which it overwrites."""
        for own, basis in zip(self.by_record(white), transients, strict=True):
            own -= basis @ (basis.T @ own)
        return white

    @cached_property
    def size(self) -> Size:
        """Of all records."""
        lines = [len(part.by_line(np.zeros((part.numbers, 1)))) for part in self.parts]
        channels = [part.judged / (2 * own) for part, own in zip(self.parts, lines, strict=True)]
        witnesses = sum(min(BANDS, own) * each for own, each in zip(lines, channels, strict=True))
        return Size(float(self.lines), witnesses)

    def residual(self, model: Model) -> FloatArray:
        """Whitened measured minus simulated, all records in a row, then what is known beforehand; J is its square."""
        return self.jacobian(model, [])[0]

    def departure(self, model: Model) -> FloatArray:
        """Whitened response of a settled model less what was measured; of two models the difference is one of both."""
        return np.concatenate([*(part.departure(part.at(model)) for part in self.parts), -known_residual(model)])

    def on_tones(self, model: Model) -> tuple[float, int]:
        """See `RecordLines.on_tones`, of all records."""
        found = [part.on_tones(part.at(model)) for part in self.in_time]
        return sum(cost for cost, _ in found), sum(numbers for _, numbers in found)

    def departure_from_rest(self, model: Model, free: Sequence[int] = ()) -> tuple[FloatArray, FloatArray]:
        """The same of a linear model that rests when the records begin, and its derivatives by the parameters."""
        departures, slopes = zip(*(part.departure_from_rest(part.at(model), free) for part in self.parts), strict=True)
        known = -known_residual(model), known_slopes(model, free)
        return np.concatenate([*departures, known[0]]), np.vstack([*slopes, known[1]])

    @property
    def measured_cost(self) -> float:
        """J of a model that answers no excitation."""
        return sum(float(np.sum(part.whitened_measured**2)) for part in self.parts)

    def slopes(self, model: Model, free: Sequence[int]) -> FloatArray:
        """Whitened derivatives of the settled response by the parameters in `free`."""
        return np.vstack([*(part.slopes(part.at(model), free) for part in self.parts), known_slopes(model, free)])

    def transients(self, model: Model) -> list[FloatArray]:
        """Of each record an orthonormal basis of what a transient can look like, whitened."""
        return [part.transients(part.at(model)) for part in self.parts]

    def white(self, model: Model, free: Sequence[int], *, roughly: bool = False) -> list[White]:
        """Every record against a model, with the derivatives by the parameters in `free`, see `RecordLines.white`."""
        return [part.white(part.at(model), free, roughly=roughly) for part in self.parts]

    def jacobian(self, model: Model, free: Sequence[int], *, roughly: bool = False) -> tuple[FloatArray, FloatArray]:
        """Whitened residual, and whitened derivative of the response by the parameters in `free`."""
        found = self.white(model, free, roughly=roughly)
        residual = np.concatenate([*(own.residual for own in found), known_residual(model)])
        return residual, np.vstack([*(own.slopes for own in found), known_slopes(model, free)])

    def quadratic(
        self,
        model: Model,
        free: Sequence[int],
        near: Sequence[FloatArray] = (),
        *,
        roughly: bool = False,
        shortly: bool = False,
    ) -> Quadratic:
        """J about a model; small whatever the length of the records.

        Parameters
        ----------
        model : Model
        free : sequence of int
        near : sequence of ndarray
            Transients of each record that are close to the best ones, as an earlier call found them.
        roughly, shortly : bool
            See `RecordLines.white`.
        """
        place, care = self._place(model), (False, False) if model.is_linear else (roughly, shortly)
        key: _Known = (place, tuple(free), care)
        if not free:  # J alone, which any of them gives that is of a long lead
            key = next((known for known in reversed(self._known) if known[0] == place and not known[2][1]), key)
        if key not in self._known:
            self._keep(key, self._quadratic(model, free, near, care))
        return self._known[key]

    def on_lines(self, model: Model) -> OnLines | None:
        """Of every loop its records on lines, with their places; None unless all are of linear models in time."""
        own: OnLines = {}
        for k, part in enumerate(self.parts):
            here = part.at(model)
            if not (here.is_linear and part.is_in_time):
                return None
            own.setdefault(here.loop.core, []).append((k, part, part.data(here)))
        return own

    def remember(self, model: Model, free: Sequence[int], ended: _core.Ended) -> None:
        """Keep the quadratic form about a model that the core ended at, its records in the order of `on_lines`."""
        order = [(k, part) for some in (self.on_lines(model) or {}).values() for k, part, _ in some]
        transients, turning = [np.zeros(0)] * len(order), [np.zeros((len(free), 0))] * len(order)
        for (k, part), transient, slopes, fitted in zip(
            order, ended["transients"], ended["slopes"], ended["fitted"], strict=True
        ):
            transients[k], turning[k] = transient, slopes
            part.remember(part.at(model), transient, fitted)
        found = Quadratic(ended["hessian"], ended["gradient"], ended["cost"], sum(ended["fitted"]), transients, turning)
        self._keep((self._place(model), tuple(free), (False, False)), found)

    def _place(self, model: Model) -> object:
        return tuple(part.at(model).loop.core for part in self.parts), model.theta.tobytes()

    def _keep(self, key: _Known, found: Quadratic) -> None:
        self._known[key] = found
        while len(self._known) > REMEMBERED:
            self._known.pop(next(iter(self._known)))

    def _quadratic(
        self, model: Model, free: Sequence[int], near: Sequence[FloatArray], care: tuple[bool, bool]
    ) -> Quadratic:
        size, cost, fitted = len(free), 0.0, 0
        hessian, gradient = np.zeros((size, size)), np.zeros(size)
        transients, turning = [np.zeros(0)] * len(self.parts), [np.zeros((size, 0))] * len(self.parts)
        own: dict[tuple[_core.ClosedLoop, bytes], list[tuple[int, RecordLines, Model]]] = {}
        for k, part in enumerate(self.parts):
            here = part.at(model)
            if here.is_linear and part.is_in_time:
                own.setdefault((here.loop.core, here.theta.tobytes()), []).append((k, part, here))
                continue
            residual, columns, states, _ = part.white(here, free, roughly=care[0], shortly=care[1])
            # whitened numbers whose squares no sum can hold
            if max(np.abs(residual).max(initial=0.0), np.abs(columns).max(initial=0.0)) > 1e100:
                raise UnstableLoopError(f"{part.record.name}: the response of the model passes all bounds")
            hessian, gradient = hessian + columns.T @ columns, gradient - columns.T @ residual
            cost, fitted = cost + float(residual @ residual), fitted + states
        for (core, _), members in own.items():
            start = [near[k] for k, _, _ in members] if near else []
            best = [part.known_transient(here) for _, part, here in members]
            if all(own is not None for own in best):
                start = [own for own in best if own is not None]
            data = [part.data(here) for _, part, here in members]
            found = _core.line_equations(core, members[0][2].theta, list(free), data, start)
            hessian, gradient = hessian + found[0], gradient + found[1]
            cost, fitted = cost + found[2], fitted + sum(found[5])
            for (k, part, here), transient, slopes, numbers in zip(members, *found[3:], strict=True):
                transients[k], turning[k] = transient, slopes
                part.remember(here, transient, numbers)
        known, slopes = known_residual(model), known_slopes(model, free)
        hessian, gradient = hessian + slopes.T @ slopes, gradient - slopes.T @ known
        cost += float(known @ known)
        return Quadratic(hessian, gradient, cost, fitted, transients, turning)


def _part(model: Model, record: Measurement, damping: float = 0.0, *, is_rough: bool = False) -> Part:
    """What was measured, on its lines; see `Noise.rough`."""
    if not record.is_in_time:
        return ResponseLines(record, model)
    measured = Measured(record, damping)
    return RecordLines(model, measured, rough=True) if is_rough else _judged(model, measured)


def _judged(model: Model, measured: Measured, angles: Mapping[str, float] | None = None) -> RecordLines:
    """A record on its judged lines, in the noise that a model leaves; as it is known of the last two."""
    here = model.at(measured.record)
    key = here.loop.core, here.theta.tobytes(), tuple(model.free), tuple((angles or {}).items())
    if key not in measured.judged:
        measured.judged[key] = _in_noise_of(model, measured, angles)
        while len(measured.judged) > 2:
            measured.judged.pop(next(iter(measured.judged)))
    return measured.judged[key]


def _in_noise_of(model: Model, measured: Measured, angles: Mapping[str, float] | None) -> RecordLines:
    """The same, the tones found that a model leaves of it."""
    part = RecordLines(model, measured, angles=angles)
    if tones := find_tones(model, part):
        part = RecordLines(model, measured, tones, angles=angles)
        if (kept := confirmed(model, part)) != tones:
            part = RecordLines(model, measured, kept, angles=angles)
    return part.where_noise_arises(model)
