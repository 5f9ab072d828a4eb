"""The claims that tests hold against independent references, from the rows that the tests wrote."""

from __future__ import annotations

import json
from itertools import groupby
from pathlib import Path
from typing import Any

from words import table

ROWS = Path(__file__).parents[1] / "validation.jsonl"
HEAD = ("claim", "reference", "tolerance", "figure", "cases", "test", "date")
TITLES = {"hidden": "Independent simulator", "real": "Machines that can be bought"}
"""Of the folders of tests that mirror no package."""


def generate(drawn: Path) -> str:
    """A section of each folder of tests."""
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()]
    return "\n\n".join(_section(part, list(own)) for part, own in groupby(rows, key=_part))


def _part(row: dict[str, Any]) -> str:
    """The folder of a test below `tests`, or its module."""
    return Path(row["test"].partition("::")[0]).parts[1].removesuffix(".py").removeprefix("test_")


def _section(part: str, rows: list[dict[str, Any]]) -> str:
    title = TITLES.get(part, part.replace("_", " ").capitalize())
    return f"## {title}\n\n{table(HEAD, [_row(row) for row in rows])}"


def _row(row: dict[str, Any]) -> list[str]:
    reference = row["reference"].format(**row["versions"])
    figures = f"{row['tolerance']:.2g}", f"{row['figure']:.2g}", str(row["cases"])
    return [row["claim"], reference, *figures, f"`{row['test']}`", row["date"]]
