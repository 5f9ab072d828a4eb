"""The tables of the rig file, from the models that read it."""

from __future__ import annotations

import json
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ambid.rig import Rig, Tolerance
from words import meanings, paragraphs, table

HEAD = ("key", "value", "unit", "allowed", "default", "meaning")
TYPES = {float: "number", int: "whole number", str: "text", bool: "`true` or `false`"}


def generate(drawn: Path) -> str:
    """A section of each table of the file, in the order of the file."""
    tables: dict[type[BaseModel], tuple[str, bool]] = {}
    for title, model, is_default in tables_of("", Rig):
        tables.setdefault(model, (title, is_default))
    return "\n\n".join(_section(title, model, is_default) for model, (title, is_default) in tables.items())


def tables_of(
    path: str, model: type[BaseModel], *, repeated: bool = False
) -> Iterator[tuple[str, type[BaseModel], bool]]:
    """The table itself, then those in it: its head in the file, and whether it is meant where no kind is written."""
    head = f"[[{path}]]" if repeated else f"[{path}]"
    yield (f"`{head}`" if path else "At the top of the file"), model, False
    for name, field in model.model_fields.items():
        inner = list(_models(field.annotation))
        key = f"{path}.{field.alias or name}".lstrip(".")
        for one in inner:
            (title, _, _), *rest = tables_of(key, one, repeated=get_origin(field.annotation) is tuple)
            kind = one.model_fields.get("kind")
            if len(inner) > 1 and kind is not None:
                title = f'{title} of `kind = "{kind.default}"`'
            yield title, one, kind is not None and _without_kind(field) == kind.default
            yield from rest


def _without_kind(field: FieldInfo) -> object:
    """The kind of a table in which none is written."""
    chosen = (getattr(own, "discriminator", None) for own in field.metadata)
    return next((choose({}) for choose in chosen if callable(choose)), None)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Models of tables that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def _section(title: str, model: type[BaseModel], is_default: bool) -> str:
    lines = meanings(model)
    fields = dict(sorted(model.model_fields.items(), key=lambda item: item[0] != "kind"))
    rows = [_row(name, field, lines) for name, field in fields.items()]
    if "kind" in fields and not is_default:
        rows[0][4] = "**needed**"
    known = {*model.model_fields, *(field.alias for field in model.model_fields.values())}
    rows += [[f"`{name}`", kind, "", "", "", text] for name, (kind, text) in lines.items() if name not in known]
    return f"### {title}\n\n{paragraphs(model)}\n\n{table(HEAD, rows)}"


def _row(name: str, field: FieldInfo, lines: dict[str, tuple[str, str]]) -> list[str]:
    key = field.alias or name
    limits = next(_limits([field.annotation, *field.metadata]), None)
    inner = list(_models(field.annotation))
    unit = limits.unit if limits else ""
    allowed = limits.allowed.removesuffix(unit).strip().replace("any number in", "") if limits else _bounds(field)
    if any(getattr(getattr(m, "func", None), "__name__", "") == "per_axis" for m in _metadata(field)):
        value = "number, or a list with one for each axis or mode"
    elif inner:
        value = "tables" if get_origin(field.annotation) is tuple else "a table"
    else:
        value = field.description.split(",")[0] if _is_matrix(field) and field.description else _value(field.annotation)
    words = lines.get(name, lines.get(key, ("", "")))[1] or ("" if name == "kind" else field.description or "")
    words = words.replace(f" [{unit}]", "") if unit else words
    if limits and limits.note and not set(limits.note.split()) <= set(words.lower().split()) | {"a"}:
        words += f" ({limits.note})"
    return [f"`{key}`", value, unit, allowed, _default(field), words]


def _metadata(field: FieldInfo) -> Iterator[Any]:
    """What is annotated to a field, and to the parts of its annotation."""
    yield from field.metadata
    for part in get_args(field.annotation):
        yield from getattr(part, "__metadata__", ())


def _limits(annotations: list[Any]) -> Iterator[Any]:
    """Ranges of numbers anywhere in an annotation."""
    for one in annotations:
        limits = getattr(getattr(one, "func", None), "__self__", one)  # a validator of each axis holds its range
        if hasattr(limits, "allowed"):
            yield limits
        yield from _limits(list(get_args(one)))


def _bounds(field: FieldInfo) -> str:
    low, high = (next((getattr(m, end) for m in field.metadata if hasattr(m, end)), None) for end in ("ge", "le"))
    return f"{low} to {high}" if low is not None and high is not None else ""


def _is_matrix(field: FieldInfo) -> bool:
    return str(field.annotation).count("tuple[") > 1


def _value(annotation: Any) -> str:
    """What kind of value a key takes, in words."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _value(parts[0])
    if origin is Literal:
        return " or ".join(f'`"{part}"`' for part in parts)
    if origin in (Union, types.UnionType):
        words = dict.fromkeys(_value(part) for part in parts if part is not type(None))
        return " or ".join(words)
    if origin is tuple:
        return f"list of {_value(parts[0])}".replace("number", "numbers")
    return TYPES.get(annotation, "value")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**needed**"
    if field.default in (None, (), Tolerance(exact=False)):
        return "left out"
    return f"`{json.dumps(field.default)}`"  # as TOML has it too
