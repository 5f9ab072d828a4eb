"""Effects as a command line gives them: ``NAME:param=value,...``."""

from __future__ import annotations

from collections.abc import Sequence
from inspect import Parameter, signature

import ambid
from ambid.errors import ModelError, RigError


def with_effects(model: ambid.Model, options: Sequence[str]) -> ambid.Model:
    """Return the model with the effects that options such as ``sensor_lag:time_constant=2e-5`` name.

    Parameters
    ----------
    model : Model
    options : sequence of str
        ``NAME`` or ``NAME:param=value,...``; each `param` is a parameter of the effect, in SI units, or a setting of
        its kind such as the ``z`` of ``seal_forces``; an axis may be given by its name. What is left out is typical
        and small.

    Raises
    ------
    ModelError
        If an effect or one of its parameters is unknown, or a value is no number or outside its range; the message
        begins with the option.
    """
    for option in options:
        try:
            model = _with_effect(model, option)
        except (ModelError, RigError) as error:
            raise ModelError(f"--effect {option}: {error}") from None
    return model


def _with_effect(model: ambid.Model, option: str) -> ambid.Model:
    name, colon, rest = option.partition(":")
    pairs = [_assignment(text) for text in rest.split(",")] if colon else []
    given = dict(pairs)
    if len(given) < len(pairs):
        raise ModelError("a parameter is named twice; keep one")
    kind = ambid.effects.find(name)
    constants = signature(type(kind)).parameters
    uncertain = {p.name for p in kind.parameters(model.rig)}
    settings = {
        key: _setting(model.rig.axes, key, given[key], constants[key])
        for key in given
        if key in constants and key not in uncertain
    }
    effect = ambid.effects.find(name, settings)
    values = {key: _number(key, text) for key, text in given.items() if key not in settings}
    known = [p.name for p in effect.parameters(model.rig)]
    unknown = [key for key in values if key not in known]
    if known and unknown:
        others = [key for key in constants if key not in known]
        of_kind = f", and the settings {', '.join(others)}" if others else ""
        raise ModelError(f"no parameter {', '.join(unknown)}; {name} has {', '.join(known)}{of_kind}")
    return _built(model.add(effect, values), effect)


def _built(model: ambid.Model, effect: ambid.Effect) -> ambid.Model:
    """The model, once its loop can be built with the effect's settings."""
    try:
        _ = model.loop
    except LookupError as error:
        settings = ", ".join(f"{key} = {value!r}" for key, value in effect.settings().items())
        raise ModelError(f"{settings}: the rig has no such place or axis ({error}); correct the setting") from None
    return model


def _assignment(text: str) -> tuple[str, str]:
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        raise ModelError(f"{text!r}: expected NAME or NAME:param=value,..., such as loop_delay:delay=5e-5")
    return key, value


def _setting(axes: tuple[str, ...], key: str, text: str, constant: Parameter) -> int | float | str:
    """A setting as the constructor of the effect takes it; an axis by its index."""
    if key == "axis" and text in axes:
        return axes.index(text)
    takes = str(constant.annotation)
    if takes.startswith("tuple"):
        raise ModelError(
            f"{key} = {text!r}: it holds a number of each axis, which an option does not take; leave it out"
        )
    if text.isdecimal() and "int" in takes:
        return int(text)
    if "str" in takes:
        return text
    if "float" in takes:
        return _number(key, text)
    raise ModelError(f"{key} = {text!r} is no whole number; give one, counted from 0")


def _number(key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"{key} = {text!r} is no number; give one in SI units, such as 3e-4") from None
