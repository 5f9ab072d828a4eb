"""The catalogue: what each effect is, its equation, its parameters, how it shows, and a typical residual."""

from __future__ import annotations

import inspect
from itertools import groupby
from pathlib import Path

from ambid.effects import CATALOGUE, Effect
from residuals import Bench, Shown, draw
from words import meanings, table

HEAD = ("parameter", "meaning", "unit", "allowed", "typical small value", "drawn below")


def generate(drawn: Path) -> str:
    """A section of each family, a part of each effect; the pictures go to the folder."""
    benches = Bench(), Bench(resistance=1.0)
    parts = [_contents()]
    for family, effects in groupby(CATALOGUE, key=_family):
        parts.append(f"## {family.capitalize()}")
        for effect in effects:
            bench = next(own for own in benches if not effect.why_not(own.rig))
            shown = bench.shown(effect)
            draw(bench, shown, drawn / f"{effect.name}.svg")
            parts.append(_part(effect, bench, shown))
    return "\n\n".join(parts)


def _family(effect: Effect) -> str:
    """Name of the file that it stands in."""
    return type(effect).__module__.rpartition(".")[2]


def _contents() -> str:
    rows = [
        [_family(effect), f"[`{effect.name}`](#{effect.name.replace('_', '-')})", effect.physics]
        for effect in CATALOGUE
    ]
    return table(["family", "effect", "physics"], rows)


def _part(effect: Effect, bench: Bench, shown: Shown) -> str:
    rows = [
        [
            f"`{p.name}`",
            p.meaning,
            "–" if p.unit == "1" else p.unit,
            f"{_number(p.lower)} to {_number(p.upper)}",
            _number(p.probe),
            _number(shown.values[p.name]),
        ]
        for p in effect.parameters(bench.rig)
    ]
    lines = [
        f"({effect.name.replace('_', '-')})=",
        f"### {effect.name.replace('_', ' ')}",
        f"`{effect.name}`: {effect.physics}.",
        f"**Equation.** {_code(effect.equation)}",
        _said(effect.attach),
        f"**Parameters.** {_said(effect.parameters)}",
        *([table(HEAD, rows)] if rows else []),
    ]
    settings = meanings(type(effect), "Attributes")
    for name, parameter in inspect.signature(type(effect)).parameters.items():
        default = f" ({parameter.default!r} if left out)" if parameter.default not in (None, ()) else ""
        meaning = f": {settings[name][1]}" if name in settings else ""
        lines.append(f"**Setting** `{name}`{default}{meaning}")
    if effect.contains:
        simpler = ", ".join(f"`{name}`" for name in effect.contains)
        lines.append(f"**Contains** {simpler}, which is named where it does as well.")
    lines += [
        f"**Shows as.** {effect.signature}.",
        f"![What {effect.name} leaves of a fit](drawn/{effect.name}.svg)",
        f"**Source.** {effect.source}.",
    ]
    return "\n\n".join(lines)


def _code(equation: str) -> str:
    """An equation of plain text; what stands behind a semicolon is another."""
    return "; ".join(f"``{part.strip()}``" for part in equation.split(";"))


def _said(method: object) -> str:
    """The docstring of a method in one paragraph."""
    return " ".join((inspect.getdoc(method) or "").split())


def _number(value: float) -> str:
    return f"{value:.3g}".replace("e-0", "e-").replace("e+0", "e").replace("-inf", "−∞").replace("inf", "∞")
