"""The model that users hold: a rig, what fills its Delta, and the values of the parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.effects import Effect, find
from ambid.errors import ModelError, RecordError
from ambid.loop.loop import Loop, Simulator
from ambid.model_file import read_model, write_model
from ambid.parameter import Parameter
from ambid.record import Record
from ambid.rig import Rig

__all__ = ["Model", "Parameter"]

UNITS = {"K_i": "N/A", "K_s": "N/m", "R": "ohm", "tau_e": "s"}


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

    Raises
    ------
    ModelError
        If the parameters do not fill every slot of Delta just once, two have one name, or a value is not positive.
    """

    def __init__(
        self,
        rig: Rig,
        parameters: Sequence[Parameter] | None = None,
        effects: Sequence[Effect] = (),
        *,
        substeps: int | None = None,
    ) -> None:
        self.rig, self.effects, self.substeps = rig, tuple(effects), substeps
        nominal = [*_nominal(rig), *(p for effect in self.effects for p in _of_effect(rig, effect, {}))]
        self.parameters = tuple(nominal if parameters is None else parameters)
        filled = [slot for parameter in self.parameters for slot in parameter.slots]
        needed = [slot for parameter in nominal for slot in parameter.slots]
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
        return self._inputs(record.i_e, record)

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
        if not effect.parameters(self.rig):
            raise ModelError(f"{effect.name} makes no sense on this rig ({effect.physics})")
        own = _of_effect(self.rig, effect, values or {})
        return Model(self.rig, [*self.parameters, *own], [*self.effects, effect], substeps=self.substeps)

    def without(self, name: str) -> Model:
        """Return the model without one of its effects."""
        effects = [effect for effect in self.effects if effect.name != name]
        if len(effects) == len(self.effects):
            raise ModelError(f"{name} is not in the model; it has {', '.join(e.name for e in self.effects) or 'none'}")
        parameters = [p for p in self.parameters if not p.name.startswith(f"{name}.")]
        return Model(self.rig, parameters, effects, substeps=self.substeps)

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
        return Loop(self.rig, self._filled_by(), self.effects, substeps=self.substeps)

    def watching(self, signals: Sequence[str]) -> Loop:
        """The loop with further outputs: signals of the plant of each axis, such as ``s`` and ``i_f``."""
        return Loop(self.rig, self._filled_by(), self.effects, watch=signals, substeps=self.substeps)

    def with_substeps(self, substeps: int | None) -> Model:
        """Return the model with a number of steps per sample of its own for nonlinear effects."""
        return Model(self.rig, self.parameters, self.effects, substeps=substeps)

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
        loop = Loop(self.rig, self._filled_by(), self.effects, noise=True, substeps=self.substeps)
        outputs = loop.simulate(self.theta, np.hstack([self._inputs(excitation, None), noise]))
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
        at = {slot: p.value for p in self.parameters for slot in p.slots}

        def mean(kind: str) -> float | None:
            own = [at[f"{kind}.{axis}"] for axis in self.rig.axes if f"{kind}.{axis}" in at]
            return float(np.mean(own)) if own else None

        bearings = [
            bearing.model_copy(
                update={
                    "force_current": tuple(at[f"K_i.{axis}"] for axis in bearing.axis_names),
                    "force_displacement": tuple(at[f"K_s.{axis}"] for axis in bearing.axis_names),
                }
            )
            for bearing in self.rig.bearings
        ]
        return self.rig.replace(
            bearings=tuple(bearings),
            amplifier=self.rig.amplifier.model_copy(update={"resistance": mean("R")}),
            actuator=self.rig.actuator.model_copy(update={"time_constant": mean("tau_e")}),
        )

    @property
    def is_stable(self) -> bool:
        """Whether every pole decays."""
        return bool(self.poles().real.max() < 0.0)

    def save(self, path: str | Path, covariance: ArrayLike | None = None) -> None:
        """Write the model as JSON: rig, effects, parameters, and their covariance where there is one.

        Parameters
        ----------
        path : str or Path
        covariance : array_like, shape (parameters, parameters), optional
            NaN for parameters that were not free.
        """
        write_model(Path(path), self.rig, self.effects, self.parameters, covariance)

    @classmethod
    def load(cls, path: str | Path, rig: Rig | None = None) -> Model:
        """Read a model that `save` wrote.

        Parameters
        ----------
        path : str or Path
        rig : Rig, optional
            Take this rig in place of the stored one, such as the same machine at another bias current.

        Raises
        ------
        ModelError
            If the file is none of ours or has been broken.
        """
        stored = read_model(Path(path))
        machine = rig or stored.rig
        try:
            effects = [find(name, settings) for name, settings in stored.effects]
            known = {p.name: p for p in cls(machine, effects=effects).parameters}
            parameters = [
                replace(known[p.name], value=p.value) if p.name in known and known[p.name].slots == p.slots else p
                for p in stored.parameters
            ]
            return cls(machine, parameters, effects)
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None

    def __repr__(self) -> str:
        rows = [f"  {p.name:12s} {p.value:12.6g} {p.unit}" for p in self.parameters]
        effects = ", ".join(effect.name for effect in self.effects) or "no effects added"
        return "\n".join([f"Model of {self.rig.name!r}, {len(self.rig.axes)} axes, {effects}", *rows])

    def _with_parameters(self, parameters: Sequence[Parameter]) -> Model:
        model = Model(self.rig, parameters, self.effects, substeps=self.substeps)
        if "loop" in self.__dict__ and [p.slots for p in model.parameters] == [p.slots for p in self.parameters]:
            model.__dict__["loop"] = self.loop  # the compiled loop does not hold values
        return model

    def _inputs(self, i_e: NDArray[np.float64], record: Record | None) -> NDArray[np.float64]:
        """The excitation, and beside it what effects drive the loop with."""
        waves = [effect.waveform(self.rig, len(i_e), record) for effect in self.effects]
        return np.hstack([i_e, *waves]) if any(wave.shape[1] for wave in waves) else i_e

    def _filled_by(self) -> dict[str, int]:
        return {slot: i for i, parameter in enumerate(self.parameters) for slot in parameter.slots}

    def _record(self, name: str, excitation: NDArray[np.float64], outputs: NDArray[np.float64]) -> Record:
        axes = self.rig.axes
        n = len(axes)
        return Record(name, self.rig.sample_rate, axes, excitation, outputs[:, :n], outputs[:, n:])


def _of_effect(rig: Rig, effect: Effect, values: Mapping[str, float]) -> list[Parameter]:
    """The parameters of an effect, at given or typical values."""
    own = effect.parameters(rig)
    unknown = set(values) - {p.name for p in own}
    if unknown:
        raise ModelError(
            f"{effect.name}: no parameter {', '.join(sorted(unknown))}; it has {', '.join(p.name for p in own)}"
        )
    return [
        Parameter(
            effect.slot(p.name),
            float(values.get(p.name, p.probe)),
            p.unit,
            (effect.slot(p.name),),
            p.lower,
            p.upper,
            p.probe,
        )
        for p in own
    ]


def _nominal(rig: Rig) -> list[Parameter]:
    """K_i and K_s of every axis as the rig gives them, R of voltage-driven coils, and one tau_e."""
    of_axes = {
        "K_i": [value for bearing in rig.bearings for value in bearing.force_current],
        "K_s": [value for bearing in rig.bearings for value in bearing.force_displacement],
    }
    if rig.amplifier.resistance is not None:
        of_axes["R"] = [rig.amplifier.resistance] * len(rig.axes)
    parameters = [
        Parameter(f"{kind}.{axis}", value, UNITS[kind], (f"{kind}.{axis}",))
        for kind, values in of_axes.items()
        for axis, value in zip(rig.axes, values, strict=True)
    ]
    if rig.actuator.time_constant is not None:
        slots = tuple(f"tau_e.{axis}" for axis in rig.axes)
        parameters.append(Parameter("tau_e", rig.actuator.time_constant, UNITS["tau_e"], slots))
    return parameters
