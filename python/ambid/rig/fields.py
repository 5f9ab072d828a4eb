"""What the models of the rig file share: ranges in SI units, and problems in the words of the file."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from inspect import Parameter, Signature
from typing import Any

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    PlainValidator,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from ambid.errors import RigError, did_you_mean

NOTHING = object()
"""Stands for the value of a key that is missing."""

_KINDS = {
    "rotor": ("finite_elements", "matrices", "modes", "mass"),
    "controller": ("pid", "state_space", "transfer_function"),
}
LEAST = 1e-30
"""Smallest size of a physical quantity that is not 0, in SI units; the inverse of less overflows in a square."""
LARGEST_VALUE = 1e100
"""Largest size of any number, in any unit: products of three are finite, and so are squares summed over a record."""


def plain(number: float) -> str:
    """Write a number as a person would type it: `1e-5`, not `1e-05`."""
    return f"{number:.6g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


@dataclass(frozen=True)
class Range:
    """A finite number from `low` to `high`; put it into `Annotated[float, Range(...)]`.

    Parameters
    ----------
    low, high : float
        Limits, both allowed, in `unit`. They are wide: they catch slips of unit or sign, not unusual machines.
    unit : str
        SI unit, empty for a pure number.
    slips : tuple of (str, float)
        Units that people write by mistake, each with its factor to `unit`.
    note : str
        What else to say to somebody whose value is out of range, such as a sign convention.
    least : float
        Smallest size of a value that is not 0.
    """

    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    slips: tuple[tuple[str, float], ...] = ()
    note: str = ""
    least: float = LEAST

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        if math.isinf(self.low) and math.isinf(self.high):
            return f"any number in {self.unit}" if self.unit else "any number"
        return f"{plain(self.low)} to {plain(self.high)} {self.unit}".rstrip()

    def complaint(self, value: Any) -> str | None:
        """Say what is wrong with `value` and what to do; None if nothing is."""
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST_VALUE:
            return f"expected a finite number of at most {plain(LARGEST_VALUE)} in size; allowed: {self.allowed}."
        if self.unit and 0.0 < abs(value) < self.least:
            return f"expected 0, or at least {plain(self.least)} {self.unit} in size; check the value and its unit."
        if self.low <= value <= self.high:
            return None
        text = f"expected {self.allowed}"
        if self.note:
            text += f" ({self.note})"
        for unit, factor in self.slips:
            if self.low <= value * factor <= self.high:
                return f"{text}; is it in {unit}? Write {plain(value * factor)}."
        if value < 0.0 and self.low <= -value <= self.high:
            return f"{text}; check the sign."
        return f"{text}; check the value and its unit."

    def validate(self, value: Any) -> float:
        """Return `value` as a float; raises the problem otherwise (for pydantic)."""
        complaint = self.complaint(value)
        if complaint:
            refuse(problem(complaint, value))
        return float(value)

    def per_axis(self, value: Any) -> float | tuple[float, ...]:
        """Validate a number, or a list with one number per axis (for pydantic)."""
        if not isinstance(value, list | tuple):
            return self.validate(value)
        if not value:
            refuse(problem("expected a number, or one number per axis; the list is empty.", value))
        refuse(*(problem(text, v, k) for k, v in enumerate(value) if (text := self.complaint(v))))
        return tuple(float(v) for v in value)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.validate)


def per_axis(limits: Range) -> PlainValidator:
    """Annotation of a key that holds a number, or one number per axis, each within `limits`."""
    return PlainValidator(limits.per_axis)


MILLIMETRES = ("millimetres", 1e-3)
MICROMETRES = ("micrometres", 1e-6)
MILLISECONDS = ("milliseconds", 1e-3)
MICROSECONDS = ("microseconds", 1e-6)
FINITE = Range()


def problem(text: str, value: Any, *location: str | int) -> InitErrorDetails:
    """One problem: what is wrong and what to do, the value found, and the key relative to the model at hand."""
    return InitErrorDetails(type=PydanticCustomError("rig", "{text}", {"text": text}), loc=location, input=value)


def refuse(*problems: InitErrorDetails) -> None:
    """Raise all `problems` together; do nothing when there are none. For use inside validators."""
    if problems:
        raise ValidationError.from_exception_data("rig", list(problems))


class Spec(BaseModel):
    """Base of every table of the rig file: frozen, without unknown keys, problems in the file's words.

    Raises
    ------
    RigError
        On construction, with one line for each problem.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Its signature has the keys alone: what is allowed in each stands in the docstring."""
        super().__pydantic_init_subclass__(**kwargs)
        keys = []
        for name, field in cls.model_fields.items():
            default = Parameter.empty if field.is_required() else field.get_default(call_default_factory=True)
            keys.append(Parameter(field.alias or name, Parameter.KEYWORD_ONLY, default=default))
        cls.__signature__ = Signature(keys)

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """The keys that are not at their defaults."""
        for name, field in type(self).model_fields.items():
            if field.is_required() or getattr(self, name) != field.get_default(call_default_factory=True):
                yield name, getattr(self, name)

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise rig_error(error, type(self).__name__, data) from None

    # Without this mark pydantic would build nested tables through __init__, and stop at the first bad one.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(cls, data: Any, handler: ModelWrapValidatorHandler["Spec"]) -> "Spec":
        if isinstance(data, Mapping):
            data = {k: v.tolist() if isinstance(v, np.ndarray | np.generic) else v for k, v in data.items()}
        try:
            return handler(data)
        except ValidationError as error:
            raise ValidationError.from_exception_data("rig", cls._reworded(error.errors())) from None

    @classmethod
    def _keys(cls) -> dict[str, str]:
        """Keys as the file has them, each with what is allowed there."""
        keys = {}
        for name, field in cls.model_fields.items():
            limits = next((m for m in field.metadata if isinstance(m, Range)), None)
            keys[field.alias or name] = field.description or (limits.allowed if limits else "a value")
        return keys

    @classmethod
    def _reworded(cls, errors: list[Any]) -> list[InitErrorDetails]:
        """Turn pydantic's own errors into problems; a list that lacks only its wrong entries is not called short."""
        parents = {error["loc"][:depth] for error in errors for depth in range(len(error["loc"]))}
        return [cls._problem(e) for e in errors if not (e["type"] == "too_short" and e["loc"] in parents)]

    @classmethod
    def _problem(cls, error: Any) -> InitErrorDetails:
        """Turn one of pydantic's own errors into a problem; problems stay as they are."""
        location, value, keys = error["loc"], error["input"], cls._keys()
        if error["type"] == "rig":
            return problem(error["msg"], value, *location)
        if not location:
            return problem(f"expected a table with the keys {', '.join(keys)}.", value)
        if error["type"] == "missing":
            return problem(f"expected {keys[location[0]]}.", NOTHING, *location)
        if error["type"] == "too_long":
            most, found = error["ctx"]["max_length"], error["ctx"]["actual_length"] or len(value)
            return problem(f"expected at most {most} entries, found {found}; {keys[location[0]]}.", value, *location)
        if error["type"] == "extra_forbidden":
            hint = did_you_mean(str(location[-1]), keys)
            return problem(f"unknown key; {hint}Allowed here: {', '.join(keys)}.", value, *location)
        if error["type"].startswith("union_tag") and isinstance(value, Mapping):
            text = f"expected {', '.join(repr(kind) for kind in _KINDS[str(location[0])])}."
            return problem(text, value.get("kind", NOTHING), *location, "kind")
        return problem(f"expected {keys.get(location[0], 'another value')}.", value, *location)


def rig_error(error: ValidationError, source: str, data: Any) -> RigError:
    """Put all problems of `source` into one error, a line each.

    Parameters
    ----------
    error : ValidationError
        What pydantic collected.
    source : str
        The file, or what else the data came from.
    data : mapping
        The data that were read, for the names of the bearings.
    """
    lines = []
    for entry in error.errors():
        found = " is missing" if entry["input"] is NOTHING else f" = {shortened(repr(entry['input']), 70)}"
        where = _path(entry["loc"], data) or "the whole"
        lines.append(f"  {source}: {where}{found}: {entry['msg']}")
    count = f"{len(lines)} problem{'s' if len(lines) > 1 else ''}"
    return RigError("\n".join([f"{source}: {count} in the description of the rig", *lines]))


def shortened(text: str, most: int) -> str:
    """A text of so many characters at the most."""
    return text if len(text) <= most else f"{text[: most - 4]} ..."


def _path(location: tuple[str | int, ...], data: Any) -> str:
    """Write a location in terms of the file: `bearing[0] (A).air_gap`."""
    path = ""
    for depth, step in enumerate(location):
        if isinstance(step, int):
            path += f"[{step}]"
            if depth == 1 and location[0] == "bearing":
                path += _bearing_name(data, step)
        elif not (depth == 1 and step in _KINDS.get(str(location[0]), ())):  # pydantic puts the kind there
            path += f".{step}" if path else step
    return path


def _bearing_name(data: Any, index: int) -> str:
    try:
        bearing = (data["bearing"] if "bearing" in data else data["bearings"])[index]
        return f" ({bearing['name'] if isinstance(bearing, Mapping) else bearing.name})"
    except (KeyError, IndexError, TypeError, AttributeError):
        return ""
