"""What a command notes of its inputs, beside its result: at once on stderr, and among the notes of its JSON."""

from __future__ import annotations

import sys
from typing import Any

from ambid.errors import printable

__all__ = ["begin_notes", "note", "with_notes"]

_told: list[str] = []


def begin_notes() -> None:
    """Forget the notes of a command before, where several run in one process."""
    _told.clear()


def note(text: str) -> None:
    """Say something once."""
    if text not in _told:
        _told.append(text)
        print(printable(f"note: {text}"), file=sys.stderr)


def with_notes(data: dict[str, Any]) -> dict[str, Any]:
    """Data for JSON with what was noted at the end of their notes; the same where nothing was."""
    return {**data, "notes": [*data.get("notes", []), *_told]} if _told else data
