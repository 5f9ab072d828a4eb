"""What a command finds in its inputs, beside its result: at once on stderr, and among the findings of its JSON."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from ambid.errors import printable
from ambid.findings import Finding

_noted: list[Finding] = []


def begin_findings() -> None:
    """Forget the findings of a command before, where several run in one process."""
    _noted.clear()


def note(finding: Finding) -> None:
    """Say something once."""
    if finding not in _noted:
        _noted.append(finding)
        print(printable(f"{finding.severity}: {finding.line()}"), file=sys.stderr)


def with_findings(data: Mapping[str, Any], more: Sequence[Finding] = ()) -> dict[str, Any]:
    """Data for JSON with the findings of its parts, of the command beside its result, and of its inputs.

    Parameters
    ----------
    data : mapping
        A result's own, whose findings stand under ``findings``, or under those of its parts.
    more : sequence of Finding
        Of the command, beside those of its result.
    """
    found = list(data["findings"]) if "findings" in data else _of_parts(data)
    further = [finding for finding in (*more, *_noted) if finding.as_dict() not in found]
    found += [finding.as_dict() for finding in further]
    notes = [*data.get("notes", []), *(finding.line() for finding in further)]
    return {**data, "findings": found} | ({"notes": notes} if notes or "notes" in data else {})


def _of_parts(value: Any) -> list[Any]:
    """The findings of what is nested in the data, each once."""
    if isinstance(value, Mapping):
        parts = [*value.get("findings", []), *(of for entry in value.values() for of in _of_parts(entry))]
    elif isinstance(value, list | tuple):
        parts = [of for entry in value for of in _of_parts(entry)]
    else:
        return []
    return [part for k, part in enumerate(parts) if part not in parts[:k]]
