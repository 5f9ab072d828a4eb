"""The uncertain numbers of a model: those of the base model, and those of effects."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from ambid.errors import ModelError, UnknownParameterError, did_you_mean
from ambid.loop.effect import Effect
from ambid.rig import Rig

SHORTEST_LAG = 5e-5
"""Samples that tau_e lasts at least: less is no lag in any record, and overflows."""
UNITS = {"K_i": "N/A", "K_s": "N/m", "R": "ohm", "tau_e": "s"}


@dataclass(frozen=True)
class Parameter:
    """An uncertain number of the model.

    Attributes
    ----------
    name : str
        Such as ``K_i.A_zeta``, ``K_s.A_zeta``, ``tau_e``.
    value : float
        Present value, in `unit`.
    unit : str
    slots : tuple of str
        Places in Delta that it fills; several where axes share it.
    lower, upper : float
        What physics allows, in `unit`.
    typical : float or None
        Size by which the optimiser scales, though misfit drive the value to nothing: of K_i, K_s, R and tau_e that of
        the rig file. None where that is its value.
    prior : float or None
        Standard deviation from 0 to which it is known before any record, in `unit`; None where nothing is known.
    """

    name: str
    value: float
    unit: str
    slots: tuple[str, ...]
    lower: float = 0.0
    upper: float = np.inf
    typical: float | None = None
    prior: float | None = None

    @property
    def scale(self) -> float:
        """A positive number of the parameter's own size."""
        return max(abs(self.value), self.typical or 0.0)


class Parameters(tuple[Parameter, ...]):
    """The parameters of a model in order, and by their names as in a dict.

    A sequence: iteration is over the parameters, in the order of `Model.theta`; `keys` are their names.
    """

    def __getitem__(self, which: Any) -> Any:
        """A parameter by its name or place; a tuple of a slice.

        Raises
        ------
        UnknownParameterError
            If there is none of this name; it is a KeyError, too.
        """
        if not isinstance(which, str):
            return super().__getitem__(which)
        if (found := self.get(which)) is None:
            near = did_you_mean(which, self.keys())
            raise UnknownParameterError(f"{which}: no such parameter; {near}the model has {', '.join(self.keys())}")
        return found

    def __contains__(self, which: object) -> bool:
        return self.get(which) is not None if isinstance(which, str) else super().__contains__(which)

    def get(self, name: str, default: Parameter | None = None) -> Parameter | None:
        """That of a name, if there is one."""
        return next((p for p in self if p.name == name), default)

    def keys(self) -> tuple[str, ...]:
        """Names."""
        return tuple(p.name for p in self)

    def values(self) -> tuple[Parameter, ...]:
        """The parameters."""
        return tuple(self)

    def items(self) -> tuple[tuple[str, Parameter], ...]:
        """Both."""
        return tuple((p.name, p) for p in self)


def of_effect(rig: Rig, effect: Effect, values: Mapping[str, float]) -> list[Parameter]:
    """The parameters of an effect, at given or typical values."""
    own = effect.parameters(rig)
    unknown = set(values) - {p.name for p in own}
    if unknown:
        raise ModelError(
            f"{effect.name}: no parameter {', '.join(sorted(unknown))}; "
            f"{did_you_mean(min(unknown), [p.name for p in own])}it has {', '.join(p.name for p in own)}"
        )
    return [
        Parameter(
            effect.slot(p.name),
            float(values.get(p.name, p.probe if p.std is None else 0.0)),
            p.unit,
            (effect.slot(p.name),),
            p.lower,
            p.upper,
            p.probe,
            p.std,
        )
        for p in own
    ]


def nominal(rig: Rig) -> list[Parameter]:
    """K_i and K_s of every axis as the rig gives them, R of voltage-driven coils, and one tau_e."""
    of_axes = {
        "K_i": [value for bearing in rig.bearings for value in bearing.force_current],
        "K_s": [value for bearing in rig.bearings for value in bearing.force_displacement],
    }
    if rig.amplifier.resistance is not None:
        of_axes["R"] = [rig.amplifier.resistance] * len(rig.axes)
    parameters = [
        Parameter(f"{kind}.{axis}", value, UNITS[kind], (f"{kind}.{axis}",), *_one_sign(value), abs(value))
        for kind, values in of_axes.items()
        for axis, value in zip(rig.axes, values, strict=True)
    ]
    if rig.actuator.time_constant is not None:
        slots, value = tuple(f"tau_e.{axis}" for axis in rig.axes), rig.actuator.time_constant
        least = min(SHORTEST_LAG / rig.sample_rate, value)
        parameters.append(Parameter("tau_e", value, UNITS["tau_e"], slots, least, typical=value))
    return parameters


def _one_sign(value: float) -> tuple[float, float]:
    """Limits that keep the sign of a value: that of K_s is the kind of magnet."""
    return (0.0, np.inf) if value > 0.0 else (-np.inf, 0.0)


def selected(parameters: Sequence[Parameter], patterns: Iterable[str]) -> list[int]:
    """Indices of the parameters that names or patterns such as ``K_i.*`` select, in order; see `Model.index`."""
    names = [parameter.name for parameter in parameters]
    found: set[int] = set()
    for pattern in patterns:
        own = {i for i, name in enumerate(names) if fnmatchcase(name, pattern)}
        own |= {i for i, name in enumerate(names) if name.startswith(f"{pattern}.")}
        if not own:
            groups = dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name)
            near = did_you_mean(pattern, [*groups, *names])
            raise ModelError(f"{pattern}: no such parameter; {near}the model has {', '.join(names)}")
        found |= own
    return sorted(found)


def shared(parameters: Sequence[Parameter], name: str, members: Iterable[str]) -> list[Parameter]:
    """The parameters with one in place of several; see `Model.share`."""
    chosen = [parameters[i] for i in selected(parameters, members)]
    if len({parameter.unit for parameter in chosen}) != 1:
        raise ModelError(f"{', '.join(p.name for p in chosen)} cannot be shared: their units differ")
    slots = tuple(slot for parameter in chosen for slot in parameter.slots)
    one = replace(chosen[0], name=name, value=float(np.mean([p.value for p in chosen])), slots=slots)
    at = parameters.index(chosen[0])
    rest = [p for p in parameters if p not in chosen]
    return [*rest[:at], one, *rest[at:]]


def split(parameters: Sequence[Parameter], name: str) -> list[Parameter]:
    """The parameters with shared ones split into one per slot; see `Model.per_axis`."""
    chosen = [parameters[i] for i in selected(parameters, [name])]
    if all(len(parameter.slots) == 1 for parameter in chosen):
        raise ModelError(f"{name}: every axis has its own {', '.join(p.name for p in chosen)} already")
    found: list[Parameter] = []
    for p in parameters:
        found += [replace(p, name=slot, slots=(slot,)) for slot in p.slots] if p in chosen else [p]
    return found


def to_rig(rig: Rig, parameters: Iterable[Parameter]) -> Rig:
    """The rig with these K_i, K_s, R and tau_e as its nominal values; of R and tau_e their means."""
    at = {slot: p.value for p in parameters for slot in p.slots}

    def mean(kind: str) -> float | None:
        own = [at[f"{kind}.{axis}"] for axis in rig.axes if f"{kind}.{axis}" in at]
        return float(np.mean(own)) if own else None

    bearings = [
        bearing.model_copy(
            update={
                "force_current": tuple(at[f"K_i.{axis}"] for axis in bearing.axis_names),
                "force_displacement": tuple(at[f"K_s.{axis}"] for axis in bearing.axis_names),
            }
        )
        for bearing in rig.bearings
    ]
    return rig.replace(
        bearings=tuple(bearings),
        amplifier=rig.amplifier.model_copy(update={"resistance": mean("R")}),
        actuator=rig.actuator.model_copy(update={"time_constant": mean("tau_e")}),
    )
