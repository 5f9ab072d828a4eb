"""What differs from run to run: values drawn about those of the rig, its effects, or the excitation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

import numpy as np

from ambid.errors import InputError

AMPLITUDE = "amplitude"
"""Key of the amplitude of the excitation, whose value is 1: it multiplies what is given."""
EXPECTED = "KEY=normal:SIZE, KEY=uniform:SIZE or KEY=uniform:LOW:HIGH, a size in SI units or such as 5%"
Kind = Literal["normal", "uniform"]


@dataclass(frozen=True)
class Spread:
    """A distribution of one value, or of each value that a pattern selects.

    Attributes
    ----------
    key : str
        ``amplitude``; a parameter of the true model or a pattern, such as ``K_i.A_*`` or ``loop_delay.delay``; or a
        number of the rig file, such as ``bearing.A.air_gap`` or ``amplifier.time_constant``.
    kind : str
        ``normal`` or ``uniform``.
    size : float
        Standard deviation, or half width, about the value; nothing where there is a `span`.
    relative : bool
        Whether the size is a part of the value.
    span : tuple of float, optional
        Limits of ``uniform`` in place of a size.
    """

    key: str
    kind: Kind
    size: float = 0.0
    relative: bool = True
    span: tuple[float, float] | None = None

    @classmethod
    def parse(cls, text: str) -> Spread:
        """Read ``KEY=DIST``, such as ``K_i=normal:5%``, ``tau_e=uniform:1e-5`` or ``amplitude=uniform:0.5:2``.

        Raises
        ------
        InputError
            If it reads otherwise.
        """
        key, _, rest = text.partition("=")
        kind, *sizes = rest.split(":")
        allowed = {("normal", 1), ("uniform", 1), ("uniform", 2)}
        if not key or (kind, len(sizes)) not in allowed or kind not in get_args(Kind):
            raise InputError(f"spread {text}: expected {EXPECTED}")
        relative = len(sizes) == 1 and sizes[0].endswith("%")
        try:
            numbers = [float(size.removesuffix("%") if relative else size) for size in sizes]
        except ValueError:
            raise InputError(f"spread {text}: {':'.join(sizes)} is no number; expected {EXPECTED}") from None
        if not np.isfinite(numbers).all() or (len(numbers) == 1 and numbers[0] < 0.0) or sorted(numbers) != numbers:
            raise InputError(f"spread {text}: expected a finite size of 0 or more, or LOW below HIGH")
        if len(numbers) == 2:
            return cls(key, "uniform", span=(numbers[0], numbers[1]))
        return cls(key, cast(Kind, kind), numbers[0] / (100.0 if relative else 1.0), relative)

    def draw(self, value: float, random: np.random.Generator) -> float:
        """One number, about `value`."""
        if self.span is not None:
            return float(random.uniform(*self.span))
        size = self.size * abs(value) if self.relative else self.size
        return value + size * float(random.standard_normal() if self.kind == "normal" else random.uniform(-1.0, 1.0))


def at_key(data: dict[str, Any], key: str) -> tuple[float, ...] | float | None:
    """The number, or numbers, of a rig's data at a key such as ``bearing.A.air_gap``; None where there is none."""
    found: Any = data
    for name in key.split("."):
        found = _member(found, name)
    if isinstance(found, int | float) and not isinstance(found, bool):
        return float(found)
    if isinstance(found, Sequence) and found and all(isinstance(own, int | float) for own in found):
        return tuple(map(float, found))
    return None


def set_key(data: dict[str, Any], key: str, value: tuple[float, ...] | float) -> None:
    """Put a number in the place of that which `at_key` found."""
    *way, last = key.split(".")
    found: Any = data
    for name in way:
        found = _member(found, name)
    found[last] = value


def _member(table: Any, name: str) -> Any:
    """An entry of a table, or of a list of tables the one with that name."""
    if isinstance(table, dict):
        return table.get(name)
    if isinstance(table, list | tuple):
        return next((own for own in table if isinstance(own, dict) and own.get("name") == name), None)
    return None
