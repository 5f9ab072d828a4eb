"""The typical tolerances of the rig file with their sources."""

from __future__ import annotations

from pathlib import Path

from ambid.rig.tolerance import SOURCES, TYPICAL, UNITS, Tolerance
from words import table


def generate(drawn: Path) -> str:
    """A row of each key."""
    rows = [[f"`{key}`", f"{TYPICAL[key]:g}", UNITS.get(key, "relative"), SOURCES[key]] for key in TYPICAL]
    assert {row[0].strip("`") for row in rows} | {"exact"} == set(Tolerance.model_fields)
    return table(("key", "typical", "unit", "source"), rows)
