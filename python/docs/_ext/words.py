"""Docstrings and tables as Markdown."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence

SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table, one line a row."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(_cell(text) for text in line) + " |" for line in lines)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def first_paragraph(described: object) -> str:
    """What a docstring says first, on one line."""
    return " ".join((inspect.getdoc(described) or "").partition("\n\n")[0].split())


def paragraphs(described: object) -> str:
    """A docstring as it stands, without its sections."""
    return SECTION.split(inspect.getdoc(described) or "")[0].strip()


def meanings(described: type, section: str = "Parameters") -> dict[str, tuple[str, str]]:
    """Type and meaning of each entry in the docstrings of a class and its bases, alike for those that share a line."""
    found: dict[str, tuple[str, str]] = {}
    for one in reversed(described.__mro__):
        _, *parts = SECTION.split(inspect.cleandoc(one.__doc__ or ""))
        text = dict(zip(parts[::2], parts[1::2], strict=True)).get(section, "")
        for head, body in re.findall(r"^(\S.*)\n?((?:^ +.*\n?|^\n)*)", text, re.MULTILINE):
            names, _, kind = head.partition(" : ")
            for name in names.split(","):
                found[name.strip()] = (kind.strip(), " ".join(body.split()))
    return found
