"""``--save-rig``: the rig file with its values that are known to a tolerance updated by records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import ambid
from ambid.errors import InputError
from ambid.findings import Finding, has

__all__ = ["Updated", "require_rig", "updated"]

HINT = "--save-rig RIG writes the rig file with these values"


class Updated(NamedTuple):
    """What is printed of an updated rig file, its JSON, what the file cannot hold, and what writes it."""

    text: str
    data: dict[str, Any]
    findings: Sequence[Finding]
    write: Callable[[], Sequence[Path]]


def require_rig(path: Path | None, start: ambid.Model) -> None:
    """Refuse to write a rig file that would be no update, or under a name that is none, before any work is done."""
    if path is None:
        return
    if path.suffix.lower() != ".toml":
        raise InputError(f"--save-rig {path}: the suffix is {path.suffix or 'missing'}; expected .toml")
    if not start.with_tolerances().tolerances:
        raise InputError(
            f"--save-rig {path}: every value of the rig file is exact, and records update none; state in its "
            "[tolerance] how well they are known"
        )


def updated(result: ambid.Estimate | ambid.Diagnosis, path: Path | None) -> Updated:
    """The update where it is asked for; else how to ask, where records move a value beyond what is usual."""
    from ambid.identification.tolerances import VALUE_MOVED  # not at the top: --help need not open that room

    if path is None:
        return Updated(f"\n  {HINT}" if has(result.findings, VALUE_MOVED) else "", {}, (), lambda: ())
    update = result.model.updated_rig()
    held = [f"  {own.line()}" for own in update.values if not own.why]
    lines = ["", "", f"updated in {path}:", *held, *(f"{own.severity}: {own.line()}" for own in update.findings)]

    def write() -> Sequence[Path]:
        update.save(path)
        return [path]

    return Updated("\n".join(lines), {"rig_update": update.to_json()}, update.findings, write)
