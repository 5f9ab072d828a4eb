"""The model that users hold: a rig, what fills its Delta, and the values of the parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.effects import CATALOGUE, Effect, find
from ambid.errors import ModelError, RecordError
from ambid.loop.loop import Loop, Simulator
from ambid.model.file import read_model, write_model
from ambid.model.operating_point import further_points, nominal_of_points, parameters_at
from ambid.model.parameter import Parameter, nominal, of_effect, to_rig
from ambid.record import Record
from ambid.rig import Rig

__all__ = ["Model", "Parameter"]


class Model:
    """A closed-loop model: rig, effects and parameters. Immutable; every change returns a new model.

    Parameters
    ----------
    rig : Rig
    parameters : sequence of Parameter, optional
        Default: K_i and K_s of every axis at the rig's nominal values, R of voltage-driven coils, one tau_e shared by
        all axes unless the actuator has no lag, and those of the effects.
    effects : sequence of Effect
        Physics beyond the base model.
    substeps : int, optional
        Steps per sample of nonlinear effects; default: as many as the response needs to be exact to 1e-6.
    points : sequence of Rig
        The same machine at other operating points, see `covering`.
    reference : Rig, optional
        Rig that the parameters of effects are stated for; default: `rig`.

    Raises
    ------
    ModelError
        If the parameters do not fill every slot of Delta just once, two have one name, a value is not positive, or a
        point is of another machine.
    """

    def __init__(
        self,
        rig: Rig,
        parameters: Sequence[Parameter] | None = None,
        effects: Sequence[Effect] = (),
        *,
        substeps: int | None = None,
        points: Sequence[Rig] = (),
        reference: Rig | None = None,
    ) -> None:
        self.rig, self.effects, self.substeps = rig, tuple(effects), substeps
        self.points, self.reference = tuple(points), rig if reference is None else reference
        self._loops: dict[Rig, Loop] = {}
        usual = [*nominal(rig), *nominal_of_points(rig, self.points)]
        usual += [p for effect in self.effects for p in of_effect(self.home_of(effect) or rig, effect, {})]
        self.parameters = tuple(usual if parameters is None else parameters)
        filled = [slot for parameter in self.parameters for slot in parameter.slots]
        needed = [slot for parameter in usual for slot in parameter.slots]
        wrong = {
            "without a value": [slot for slot in needed if slot not in filled],
            "not of this rig": [slot for slot in filled if slot not in needed],
            "filled twice": sorted({slot for slot in filled if filled.count(slot) > 1}),
            "the name of two parameters": sorted({name for name in self.names if self.names.count(name) > 1}),
        }
        if any(wrong.values()):
            found = "; ".join(f"{', '.join(slots)}: {what}" for what, slots in wrong.items() if slots)
            raise ModelError(f"{found}; give every parameter a name of its own, and each of the rig's values just once")
        for parameter in self.parameters:
            low, high = parameter.lower, parameter.upper
            if not (np.isfinite(parameter.value) and low <= parameter.value <= high and parameter.scale > 0.0):
                allowed = "a positive number" if (low, high) == (0.0, np.inf) else f"{low:g} to {high:g}"
                raise ModelError(f"{parameter.name} = {parameter.value}: expected {allowed} in {parameter.unit}")

    @cached_property
    def is_linear(self) -> bool:
        """Whether no effect of the model is nonlinear."""
        return not self.loop.lft.blocks

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def theta(self) -> NDArray[np.float64]:
        """Values of all parameters, in the order of `names`, SI units."""
        return np.array([parameter.value for parameter in self.parameters])

    def with_values(self, values: Mapping[str, float]) -> Model:
        """Return the model with other values of some parameters.

        Raises
        ------
        ModelError
            If a name is unknown or a value is not positive.
        """
        self.index(values)
        changed = [replace(p, value=float(values.get(p.name, p.value))) for p in self.parameters]
        return self._with_parameters(changed)

    def with_theta(self, theta: ArrayLike) -> Model:
        """Return the model with other values of all parameters, in the order of `names`."""
        return self.with_values(dict(zip(self.names, np.asarray(theta, dtype=np.float64), strict=True)))

    def excitation(self, record: Record) -> NDArray[np.float64]:
        """Inputs of the loop during a record, shape (N, inputs): i_e, then those of disturbances in the model.

        Raises
        ------
        RecordError
            If i_e was neither logged nor rebuilt.
        """
        if record.i_e is None:
            raise RecordError(
                f"{record.path or record.name}: i_e was not logged; load the record with its rig, whose controller "
                "rebuilds it"
            )
        return self.at(record)._inputs(record.i_e, record)

    def response(self, record: Record) -> NDArray[np.float64]:
        """Simulated y and i_c of a record's experiment, shape (N, outputs), at its operating point."""
        here = self.at(record)
        return here.loop.simulate(here.theta, here.excitation(record))

    def sensitivity(self, record: Record, free: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same, and its derivative by the parameters in `free`, shape (N, outputs, free)."""
        here = self.at(record)
        return here.loop.sensitivity(here.theta, here.excitation(record), free)

    def covering(self, records: Iterable[Record]) -> Model:
        """Return the model with the operating points of these records.

        A further bias current brings a K_i and K_s of its own for every axis, such as ``K_i.A_zeta@8A``.

        Raises
        ------
        ModelError
            If a record is of another machine.
        """
        points = further_points(self.rig, self.points, records)
        if len(points) == len(self.points):
            return self
        more = [p for p in nominal_of_points(self.rig, points) if p.name not in self.names]
        return Model(self.rig, [*self.parameters, *more], self.effects, substeps=self.substeps, points=points)

    def at(self, where: Record | Rig) -> Model:
        """The model at an operating point of the machine: its rig, with the K_i and K_s of that bias current.

        Names, order and values of the parameters stay; those of other bias currents fill nothing.

        Raises
        ------
        ModelError
            If the point has a bias current that the model does not cover, or is of another machine.
        """
        rig = where if isinstance(where, Rig) else where.point
        if rig is None or rig is self.rig or rig == self.rig:
            return self
        own = parameters_at(rig, self.rig, self.points, self.parameters, self.effects)
        view = Model(rig, own, self.effects, substeps=self.substeps, reference=self.reference)
        if rig not in self._loops:
            self._loops[rig] = view.loop
        view.__dict__["loop"] = self._loops[rig]
        return view

    def home_of(self, effect: Effect) -> Rig | None:
        """The first operating point where an effect makes sense; None if it does nowhere."""
        return next((rig for rig in (self.rig, *self.points) if effect.parameters(rig)), None)

    def add(self, effect: Effect | str, values: Mapping[str, float] | None = None) -> Model:
        """Return the model with one more physical effect.

        Parameters
        ----------
        effect : Effect or str
            One of your own, or the name of one of the catalogue, such as ``loop_delay``.
        values : mapping of str to float, optional
            Start values by parameter such as ``delay``; default: typical small ones.

        Raises
        ------
        ModelError
            If the name is unknown, the effect is there already, or makes no sense on this rig.
        """
        effect = find(effect) if isinstance(effect, str) else effect
        if effect.name in (own.name for own in self.effects):
            raise ModelError(f"{effect.name} is in the model already")
        home = self.home_of(effect)
        if home is None:
            raise ModelError(f"{effect.name} makes no sense on this rig ({effect.physics})")
        return self._changed([*self.parameters, *of_effect(home, effect, values or {})], [*self.effects, effect])

    def without(self, name: str) -> Model:
        """Return the model without one of its effects."""
        effects = [effect for effect in self.effects if effect.name != name]
        if len(effects) == len(self.effects):
            raise ModelError(f"{name} is not in the model; it has {', '.join(e.name for e in self.effects) or 'none'}")
        parameters = [p for p in self.parameters if not p.name.startswith(f"{name}.")]
        return self._changed(parameters, effects)

    def share(self, name: str, members: Iterable[str]) -> Model:
        """Return the model with one parameter in place of several, starting from their mean.

        Parameters
        ----------
        name : str
            Name of the shared parameter, such as ``K_i.A``.
        members : iterable of str
            Names or patterns of the parameters that it replaces, such as ``K_i.A_*``.
        """
        chosen = [self.parameters[i] for i in self.index(members)]
        if len({parameter.unit for parameter in chosen}) != 1:
            raise ModelError(f"{', '.join(p.name for p in chosen)} cannot be shared: their units differ")
        slots = tuple(slot for parameter in chosen for slot in parameter.slots)
        shared = Parameter(name, float(np.mean([p.value for p in chosen])), chosen[0].unit, slots)
        at = self.parameters.index(chosen[0])
        rest = [p for p in self.parameters if p not in chosen]
        return self._with_parameters([*rest[:at], shared, *rest[at:]])

    def per_axis(self, name: str) -> Model:
        """Return the model with shared parameters split into one per axis, all starting from the shared value.

        Parameters
        ----------
        name : str
            Name or pattern of the shared parameters, such as ``tau_e``.

        Raises
        ------
        ModelError
            If there is no such parameter, or none that several axes share.
        """
        chosen = [self.parameters[i] for i in self.index([name])]
        if all(len(parameter.slots) == 1 for parameter in chosen):
            raise ModelError(f"{name}: every axis has its own {', '.join(p.name for p in chosen)} already")
        split: list[Parameter] = []
        for p in self.parameters:
            split += [Parameter(slot, p.value, p.unit, (slot,)) for slot in p.slots] if p in chosen else [p]
        return self._with_parameters(split)

    def index(self, patterns: Iterable[str]) -> list[int]:
        """Indices of the parameters that names or patterns such as ``K_i.*`` select, in the model's order.

        Raises
        ------
        ModelError
            If one of them selects nothing.
        """
        found: set[int] = set()
        for pattern in patterns:
            own = {i for i, name in enumerate(self.names) if fnmatchcase(name, pattern)}
            own |= {i for i, name in enumerate(self.names) if name.startswith(f"{pattern}.")}
            if not own:
                raise ModelError(f"{pattern}: no such parameter; the model has {', '.join(self.names)}")
            found |= own
        return sorted(found)

    @cached_property
    def loop(self) -> Loop:
        """The closed loop, inputs i_e, outputs y and i_c."""
        return self._compiled()

    def watching(self, signals: Sequence[str], inlets: Sequence[Effect] = ()) -> Loop:
        """The loop with further outputs: signals of the plant of each axis, such as ``s`` and ``i_f``.

        `inlets` are effects without parameters that bring further inputs.
        """
        return self._compiled(watch=signals, more=inlets)

    def with_noise_inputs(self) -> Loop:
        """The loop with sensor noise as a further input of each axis."""
        return self._compiled(noise=True)

    def with_substeps(self, substeps: int | None) -> Model:
        """Return the model with a number of steps per sample of its own for nonlinear effects."""
        model = self._changed(self.parameters, self.effects)
        model.substeps = substeps
        return model

    def simulate(self, i_e: ArrayLike) -> Record:
        """Response from rest to an excitation, without noise.

        Parameters
        ----------
        i_e : array_like, shape (N, axes)
            [A], held from sample to sample.

        Returns
        -------
        Record
            With y [m] and i_c [A].

        Raises
        ------
        UnstableLoopError
            If the closed loop is unstable.
        """
        excitation = np.asarray(i_e, dtype=np.float64)
        return self._record("simulated", excitation, self.loop.simulate(self.theta, self._inputs(excitation, None)))

    def virtual_experiment(
        self, i_e: ArrayLike, *, sensor_noise: float = 50e-9, current_noise: float = 1e-2, seed: int | None = None
    ) -> Record:
        """Simulate what an instrument would record: noise on the displacements goes round the loop.

        Parameters
        ----------
        i_e : array_like, shape (N, axes)
            [A].
        sensor_noise : float
            Rms of white noise on every displacement [m]; the controller reads it too.
        current_noise : float
            Rms of white noise on every recorded current [A].
        seed : int, optional

        Raises
        ------
        ModelError
            If a noise or the seed is negative.
        UnstableLoopError
            If the closed loop is unstable.
        """
        for name, rms in {"sensor_noise": sensor_noise, "current_noise": current_noise}.items():
            if not (np.isfinite(rms) and rms >= 0.0):
                raise ModelError(f"{name} = {rms:g}: expected an rms of 0 or more, in m or A")
        if seed is not None and seed < 0:
            raise ModelError(f"seed = {seed}: expected a whole number of 0 or more")
        excitation = np.asarray(i_e, dtype=np.float64)
        random = np.random.default_rng(seed)
        noise = sensor_noise * random.standard_normal(excitation.shape)
        outputs = self.with_noise_inputs().simulate(self.theta, np.hstack([self._inputs(excitation, None), noise]))
        n = len(self.rig.axes)
        outputs[:, n:] += current_noise * random.standard_normal(excitation.shape)
        return self._record("virtual experiment", excitation, outputs)

    def simulator(self) -> Simulator:
        """Return the embedded simulator of the loop: one sample at a time."""
        return self.loop.simulator(self.theta)

    def poles(self) -> NDArray[np.complex128]:
        """Poles of the closed loop [1/s], slowest first; a digital loop's are ln(mu) fs of its poles mu."""
        return self.loop.poles(self.theta)

    def to_rig(self) -> Rig:
        """Return the rig with the model's K_i, K_s, R and tau_e as its nominal values; of R and tau_e their means."""
        return to_rig(self.rig, self.parameters)

    @property
    def decay_rate(self) -> float:
        """Of the slowest pole, at whichever operating point [1/s]; negative where the loop is unstable."""
        return min(-float(self.at(rig).poles().real.max()) for rig in (self.rig, *self.points))

    @property
    def is_stable(self) -> bool:
        """Whether every pole decays."""
        return self.decay_rate > 0.0

    def save(self, path: str | Path, covariance: ArrayLike | None = None) -> None:
        """Write the model as JSON: rig, effects, parameters, and their covariance where there is one.

        Parameters
        ----------
        path : str or Path
        covariance : array_like, shape (parameters, parameters), optional
            NaN for parameters that were not free.
        """
        write_model(Path(path), self.rig, self.effects, self.parameters, covariance, self.points)

    @classmethod
    def load(cls, path: str | Path, rig: Rig | None = None, *, catalogue: Sequence[Effect] = CATALOGUE) -> Model:
        """Read a model that `save` wrote.

        Parameters
        ----------
        path : str or Path
        rig : Rig, optional
            Take this rig in place of the stored one, such as the same machine at another bias current.
        catalogue : sequence of Effect
            Where its effects are found by name; a model with effects of your own needs them here, such as
            ``(*CATALOGUE, own)``.

        Raises
        ------
        ModelError
            If the file is none of ours or has been broken, or an effect of it is not in the catalogue.
        """
        stored = read_model(Path(path))
        unknown = {name for name, _ in stored.effects} - {effect.name for effect in catalogue}
        if unknown:
            raise ModelError(
                f"{path}: {', '.join(sorted(unknown))}: no such effect in the catalogue; a model with effects of your "
                "own is loaded by Model.load(..., catalogue=(*CATALOGUE, own))"
            )
        machine = rig or stored.rig
        try:
            effects = [find(name, settings, catalogue) for name, settings in stored.effects]
            known = {p.name: p for p in cls(machine, effects=effects, points=stored.points).parameters}
            parameters = [
                replace(known[p.name], value=p.value) if p.name in known and known[p.name].slots == p.slots else p
                for p in stored.parameters
            ]
            return cls(machine, parameters, effects, points=stored.points)
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None

    def __repr__(self) -> str:
        rows = [f"  {p.name:12s} {p.value:12.6g} {p.unit}" for p in self.parameters]
        effects = ", ".join(effect.name for effect in self.effects) or "no effects added"
        return "\n".join([f"Model of {self.rig.name!r}, {len(self.rig.axes)} axes, {effects}", *rows])

    def _with_parameters(self, parameters: Sequence[Parameter]) -> Model:
        model = self._changed(parameters, self.effects)
        if [p.slots for p in model.parameters] == [p.slots for p in self.parameters]:
            model._loops = self._loops  # compiled loops do not hold values
            if "loop" in self.__dict__:
                model.__dict__["loop"] = self.loop
        return model

    def _changed(self, parameters: Sequence[Parameter], effects: Sequence[Effect]) -> Model:
        own, points, reference = self.substeps, self.points, self.reference
        return Model(self.rig, parameters, effects, substeps=own, points=points, reference=reference)

    @property
    def acting(self) -> list[Effect]:
        """Effects that make sense at this operating point."""
        return [effect for effect in self.effects if effect.parameters(self.rig)]

    def _compiled(self, *, noise: bool = False, watch: Sequence[str] = (), more: Sequence[Effect] = ()) -> Loop:
        filled_by = {slot: i for i, parameter in enumerate(self.parameters) for slot in parameter.slots}
        return Loop(
            self.rig,
            filled_by,
            [*self.acting, *more],
            noise=noise,
            watch=watch,
            substeps=self.substeps,
            reference=self.reference,
            parameters=len(self.parameters),
        )

    def _inputs(self, i_e: NDArray[np.float64], record: Record | None) -> NDArray[np.float64]:
        """The excitation, and beside it what effects drive the loop with."""
        waves = [effect.waveform(self.rig, len(i_e), record) for effect in self.acting]
        return np.hstack([i_e, *waves]) if any(wave.shape[1] for wave in waves) else i_e

    def _record(self, name: str, excitation: NDArray[np.float64], outputs: NDArray[np.float64]) -> Record:
        n = len(self.rig.axes)
        record = Record(name, self.rig.sample_rate, self.rig.axes, excitation, outputs[:, :n], outputs[:, n:])
        return record if self.reference is self.rig else record.at(self.rig)
