"""The uncertain numbers of a model: those of the base model, and those of effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ambid.errors import ModelError
from ambid.loop.effect import Effect
from ambid.rig import Rig

__all__ = ["UNITS", "Parameter", "nominal", "of_effect", "to_rig"]

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
        Size by which the optimiser scales; None where that is its value.
    """

    name: str
    value: float
    unit: str
    slots: tuple[str, ...]
    lower: float = 0.0
    upper: float = np.inf
    typical: float | None = None

    @property
    def scale(self) -> float:
        """A positive number of the parameter's own size."""
        return self.value if self.typical is None else max(abs(self.value), self.typical)


def of_effect(rig: Rig, effect: Effect, values: Mapping[str, float]) -> list[Parameter]:
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


def nominal(rig: Rig) -> list[Parameter]:
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
