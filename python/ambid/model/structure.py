"""What a model is made of beside its values: a rig, effects, and further operating points of the same machine."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ambid.errors import ModelError
from ambid.loop.effect import Effect
from ambid.loop.loop import Loop, open_plant
from ambid.model.operating_point import nominal_of_points
from ambid.model.parameter import Parameter, nominal, of_effect
from ambid.results import of_unit
from ambid.rig import Rig


@dataclass(frozen=True)
class Structure:
    """What a model is made of beside its values.

    Attributes
    ----------
    rig : Rig
    effects : tuple of Effect
        Physics beyond the base model.
    points : tuple of Rig
        The same machine at other operating points.
    reference : Rig
        That the parameters of effects are stated for.
    substeps : int or None
        Steps per sample of nonlinear effects; None for as many as the response needs to be exact to 1e-6.
    known : tuple of Effect
        Values of the rig file that are known to a tolerance, see `ambid.effects.known`; none where all are exact.
    is_open : bool
        Whether the loop has ports for all of their errors; else for those that are not zero, which it runs faster with.
    measured : tuple of str
        Channels of the record that it is compared with, where that holds more than y and i_c: the loop's first outputs.
    """

    rig: Rig
    effects: tuple[Effect, ...]
    points: tuple[Rig, ...]
    reference: Rig
    substeps: int | None = None
    known: tuple[Effect, ...] = ()
    is_open: bool = False
    measured: tuple[str, ...] = ()

    @property
    def acting(self) -> list[Effect]:
        """Effects that make sense at this operating point."""
        return [effect for effect in self.effects if effect.parameters(self.rig) or not effect.why_not(self.rig)]

    def home_of(self, effect: Effect) -> Rig | None:
        """The first operating point where an effect makes sense; None if it does nowhere."""
        return next((rig for rig in (self.rig, *self.points) if not effect.why_not(rig)), None)

    def usual_parameters(self) -> list[Parameter]:
        """One for every slot of Delta, at the rig's nominal values and typical ones of the effects."""
        usual = [*nominal(self.rig), *nominal_of_points(self.rig, self.points)]
        usual += [p for effect in self.known for p in of_effect(self.rig, effect, {})]
        return usual + [p for effect in self.effects for p in of_effect(self.home_of(effect) or self.rig, effect, {})]

    def compiled(
        self,
        parameters: Sequence[Parameter],
        *,
        noise: bool = False,
        watch: Sequence[str] = (),
        more: Iterable[Effect] = (),
    ) -> Loop:
        """The closed loop with these parameters in its slots; see `Loop` for the rest."""
        acting = (*(effect.without_probe() for effect in self.acting), *self.erring(parameters), *more)
        slots = tuple(parameter.slots for parameter in parameters)
        return _compiled(self.rig, acting, slots, noise, tuple(watch), self.substeps, self.reference, self.measured)

    def erring(self, parameters: Iterable[Parameter]) -> tuple[Effect, ...]:
        """The known values whose errors the loop has ports for."""
        off = {p.name.partition(".")[0] for p in parameters if p.prior is not None and p.value != 0.0}
        return self.known if self.is_open else tuple(effect for effect in self.known if effect.name in off)

    def require_filled(self, parameters: Sequence[Parameter]) -> None:
        """Refuse parameters that do not fill every slot of Delta just once, or hold a value that is not allowed.

        Raises
        ------
        ModelError
            Naming the slots and the names that are wrong.
        """
        names = [parameter.name for parameter in parameters]
        filled = [slot for parameter in parameters for slot in parameter.slots]
        needed = [slot for parameter in self.usual_parameters() for slot in parameter.slots]
        wrong = {
            "without a value": [slot for slot in needed if slot not in filled],
            "not of this rig": [slot for slot in filled if slot not in needed],
            "filled twice": sorted({slot for slot in filled if filled.count(slot) > 1}),
            "the name of two parameters": sorted({name for name in names if names.count(name) > 1}),
        }
        if any(wrong.values()):
            found = "; ".join(f"{', '.join(slots)}: {what}" for what, slots in wrong.items() if slots)
            raise ModelError(f"{found}; give every parameter a name of its own, and each of the rig's values just once")
        require_allowed(parameters)


def require_allowed(parameters: Sequence[Parameter]) -> None:
    """Refuse values that are not allowed.

    Raises
    ------
    ModelError
        Naming the parameter.
    """
    for parameter in parameters:
        low, high = parameter.lower, parameter.upper
        if not (np.isfinite(parameter.value) and low <= parameter.value <= high and parameter.scale > 0.0):
            allowed = "a positive number" if (low, high) == (0.0, np.inf) else f"{low:g} to {high:g}"
            unit = f" in{of_unit(parameter.unit)}" if parameter.unit != "1" else ""
            raise ModelError(f"{parameter.name} = {parameter.value}: expected {allowed}{unit}")


@lru_cache(maxsize=8)
def _compiled(
    rig: Rig,
    acting: tuple[Effect, ...],
    slots: tuple[tuple[str, ...], ...],
    noise: bool,
    watch: tuple[str, ...],
    substeps: int | None,
    reference: Rig,
    measured: tuple[str, ...],
) -> Loop:
    """The closed loop; many models that are tried after each other differ in their values alone."""
    return Loop(
        rig,
        {slot: i for i, own in enumerate(slots) for slot in own},
        acting,
        noise=noise,
        watch=watch,
        substeps=substeps,
        reference=reference,
        parameters=len(slots),
        measured=measured,
    )


@lru_cache(maxsize=256)
def is_nonlinear(rig: Rig, effect: Effect) -> bool:
    """Whether an effect has nonlinear blocks on this rig."""
    return bool(open_plant(rig, [effect]).blocks)
