"""``--save-rig``: the rig file, updated by records; ``--mend``: records without the errors that a diagnosis names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import ambid
from ambid.cli.files import count_of
from ambid.errors import InputError
from ambid.findings import Finding, Kind, Where, has

DOUBTFUL = Kind(
    "rig_update_doubtful",
    "warning",
    "physics is missing, and the values in the updated rig file may have taken up a part of it",
    "find what is missing first",
)
NOT_UPDATED = Kind(
    "rig_not_updated", "warning", "not written: the records were not fitted with the errors of the rig file's values"
)
NOT_MENDED = Kind(
    "record_not_mended", "warning", "not written: no error of a record is named that could be taken out of it"
)


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

    fit = result.comparison if isinstance(result, ambid.Estimate) else result.fit
    is_adequate = fit is not None and fit.is_adequate
    if path is None:
        is_asked = is_adequate and has(result.findings, VALUE_MOVED)
        hint = "\n  --save-rig RIG writes the rig file with these values"
        return Updated(hint if is_asked else "", {}, (), lambda: ())
    if not result.tolerances:
        none = NOT_UPDATED(Where(file=str(path)))
        return Updated(f"\n{none.severity}: {none.line()}", {"rig_update": {}}, (none,), lambda: ())
    update = result.model.updated_rig()
    doubts = () if is_adequate else (DOUBTFUL(Where(file=str(path))),)
    findings = (*doubts, *update.findings)
    held = [f"  {own.line()}" for own in update.values if not own.why]
    lines = ["", "", f"updated in {path}:", *held, *(f"{own.severity}: {own.line()}" for own in findings)]

    def write() -> Sequence[Path]:
        update.save(path, more=[own.message for own in doubts])
        return [path]

    return Updated("\n".join(lines), {"rig_update": update.to_json()}, findings, write)


def files_of_mended(path: Path | None, records: Sequence[Path]) -> list[Path]:
    """Where mended records are written, numbered where there are several; their format is checked before any work."""
    if path is None:
        return []
    from ambid.record.writers import require_format  # not at the top: --help need not open that room

    require_format(path)
    return ambid.plot.picture_files(path, count_of(records))


def mended(found: ambid.Diagnosis, files: Sequence[Path]) -> Updated:
    """The records without the errors that are named, and what was corrected."""
    if not files:
        return Updated("", {}, (), lambda: ())
    pairs = zip(files, found.records, found.mended(), strict=True)
    changed = [(path, new) for path, old, new in pairs if new.is_in_time and new is not old]
    if not changed:
        none = NOT_MENDED(Where(file=str(files[0])))
        return Updated(f"\n{none.severity}: {none.line()}", {"mended": {}}, (none,), lambda: ())
    values = {p.name: p.value for p in found.model.parameters}
    corrected = []
    for effect in found.model.effects:
        own = {p.name: values[effect.slot(p.name)] for p in effect.parameters(found.model.rig)}
        if effect.mended(changed[0][1], own) is not changed[0][1]:
            corrected += [finding.line(advises=False) for finding in effect.findings(found.model.rig, own)]

    def write() -> Sequence[Path]:
        for path, record in changed:
            record.save(path)
        return [path for path, _ in changed]

    names = [str(path) for path, _ in changed]
    lines = ["", "", f"corrected in {', '.join(names)}:", *(f"  {line}" for line in corrected)]
    return Updated("\n".join(lines), {"mended": dict.fromkeys(names, corrected)}, (), write)
