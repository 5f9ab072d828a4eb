"""Every kind of finding, from where it is declared: code, severity, message, remedy, by the room that makes it."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import ambid
from ambid.findings import KINDS, SEVERITIES, Kind
from words import table

PACKAGE = Path(ambid.__file__).parent
DECLARED = re.compile(r'\bKind\(\s*"(\w+)"')
FIELD = re.compile(r"\{(\w+)[^{}]*\}")
"""A value of a template, with its format."""


def kinds() -> dict[str, list[Kind]]:
    """By room, worst first, then by code."""
    found: dict[str, list[Kind]] = {}
    for room, code in _declared():
        found.setdefault(room, []).append(KINDS[code])
    return {
        room: sorted(own, key=lambda kind: (SEVERITIES.index(kind.severity), kind.code)) for room, own in found.items()
    }


def _declared() -> Iterator[tuple[str, str]]:
    """Room and code of every declaration, whose module is imported for it."""
    for path in sorted(PACKAGE.rglob("*.py")):
        codes = DECLARED.findall(path.read_text(encoding="utf-8"))
        if codes:
            parts = path.relative_to(PACKAGE).with_suffix("").parts
            importlib.import_module(".".join(["ambid", *parts]).removesuffix(".__init__"))
            yield from ((parts[0], code) for code in codes)


def generate(drawn: Path) -> str:
    """A table of each room."""
    return "\n\n".join(_section(room, own) for room, own in kinds().items())


def _section(room: str, own: list[Kind]) -> str:
    rows = [[f"`{kind.code}`", kind.severity, _template(kind.message), _template(kind.remedy)] for kind in own]
    return f"### From `ambid.{room}`\n\n{table(['code', 'severity', 'message', 'remedy'], rows)}"


def _template(text: str) -> str:
    """With the names of its values, and without their formats."""
    named = FIELD.sub(r"{\1}", text.replace("`", "'"))
    return f"`{named}`" if named else ""
