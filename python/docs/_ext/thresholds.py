"""Every constant of the engine: its value as it is imported, its meaning as it is written below or behind it."""

from __future__ import annotations

import ast
import importlib
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from words import table

ENGINE = ("record", "noise", "identification", "robustness", "checking", "diagnosis")
"""Packages whose constants decide something."""


@dataclass(frozen=True)
class Constant:
    """One number, or a few, that the engine holds.

    Attributes
    ----------
    package, module, name : str
    value : number, sequence of numbers or text
    meaning : str
        Empty if the source says nothing.
    """

    package: str
    module: str
    name: str
    value: Any
    meaning: str

    @property
    def text(self) -> str:
        """The value as a person would write it."""
        return _text(self.value)


@cache
def constants(package: str) -> tuple[Constant, ...]:
    """The numbers that the modules of a package of `ambid` define, private ones included."""
    found: list[Constant] = []
    face = importlib.import_module(f"ambid.{package}")
    for info in pkgutil.walk_packages(face.__path__, f"{face.__name__}."):
        module = importlib.import_module(info.name)
        source = Path(str(module.__file__)).read_text(encoding="utf-8")
        short = info.name.removeprefix(f"{face.__name__}.")
        for name, meaning in _assigned(source):
            value = getattr(module, name)
            if _is_numeric(value):
                found.append(Constant(package, short, name, value, meaning))
    return tuple(found)


def _assigned(source: str) -> Iterator[tuple[str, str]]:
    """Names in capitals at the top of a module, and what is said of them: a text below, or a comment behind."""
    body, lines = ast.parse(source).body, source.splitlines()
    for statement, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(statement, ast.Assign | ast.AnnAssign):
            continue
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name) and n.id.isupper()]
        meaning = lines[(statement.end_lineno or 1) - 1].partition("  # ")[2]
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
            meaning = " ".join(after.value.value.split())
        yield from ((name, meaning) for name in names)


def _is_numeric(value: Any) -> bool:
    if isinstance(value, tuple | list | np.ndarray):
        return len(value) > 0 and all(_is_numeric(one) or isinstance(one, str) for one in value) and _has_number(value)
    return isinstance(value, int | float | np.generic) and not isinstance(value, bool)


def _has_number(value: Any) -> bool:
    flat = (part for one in value for part in (one if isinstance(one, tuple | list) else [one]))
    return any(not isinstance(part, str) for part in flat)


def _text(value: Any) -> str:
    if isinstance(value, tuple | list | np.ndarray):
        return ", ".join(map(_text, value))
    if isinstance(value, str):
        return value
    return f"{value:.6g}".replace("e-0", "e-").replace("e+0", "e").replace("inf", "∞")


def value_text(package: str, name: str) -> str:
    """The value of a constant, for running text.

    Raises
    ------
    KeyError
        If no module of the package defines it, or two do so with two values.
    """
    values = {constant.text for constant in constants(package) if constant.name == name}
    if len(values) != 1:
        raise KeyError(
            f"{{{{{package}.{name}}}}}: {len(values)} values in ambid.{package}; name a constant that is there"
        )
    return values.pop()


def generate(drawn: Path) -> str:
    """A table of each package."""
    return "\n\n".join(_section(package) for package in ENGINE)


def _section(package: str) -> str:
    rows = [
        [f"`{c.name.lstrip('_')}`", c.text, c.meaning[:1].upper() + c.meaning[1:], f"`{c.module}`"]
        for c in constants(package)
    ]
    summary = (importlib.import_module(f"ambid.{package}").__doc__ or "").strip().splitlines()[0]
    return f"### `ambid.{package}`\n\n{summary}\n\n{table(['constant', 'value', 'meaning', 'module'], rows)}"
