"""The catalogue of physical effects that a model may lack, and of errors of rig and record: a file per family."""

from collections.abc import Mapping, Sequence
from inspect import signature
from typing import Any

from ambid.effects import amplifier, channels, coil, damping, disturbance, magnet, rotor, sensor, slips, support
from ambid.effects.measured import MeasuredShape
from ambid.errors import ModelError, did_you_mean
from ambid.loop.effect import Effect, EffectParameter, Seen, Trait

__all__ = ["CATALOGUE", "Effect", "EffectParameter", "MeasuredShape", "Seen", "Trait", "find"]

CATALOGUE: tuple[Effect, ...] = (
    *rotor.EFFECTS,
    *support.EFFECTS,
    *damping.EFFECTS,
    *magnet.EFFECTS,
    *amplifier.EFFECTS,
    *coil.EFFECTS,
    *sensor.EFFECTS,
    *disturbance.EFFECTS,
    *slips.EFFECTS,
    *channels.EFFECTS,
)


def find(name: str, settings: Mapping[str, Any] | None = None, catalogue: Sequence[Effect] = CATALOGUE) -> Effect:
    """Effect of a catalogue by name; with settings, the variant of it that they make.

    Raises
    ------
    ModelError
        If there is none, or it has no such settings.
    """
    for effect in catalogue:
        if effect.name == name:
            return effect if settings is None or settings == effect.settings() else _variant(effect, settings)
    names = [effect.name for effect in catalogue]
    raise ModelError(f"{name}: no such effect; {did_you_mean(name, names)}the catalogue has {', '.join(names)}")


def _variant(effect: Effect, settings: Mapping[str, Any]) -> Effect:
    known = signature(type(effect)).parameters
    unknown = [key for key in settings if key not in known]
    if unknown:
        raise ModelError(f"{effect.name}: no settings {', '.join(unknown)}; it has {', '.join(known) or 'none'}")
    return type(effect)(**settings)
