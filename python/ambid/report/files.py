"""The files that a diagnosis was made of, as they were read, with what tells whether somebody else holds the same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ambid.diagnosis import Diagnosis
from ambid.reading import Provenance

SHORT = 16
"""Hexadecimal digits of a hash that are shown: two different files share them by chance in one of 2e19 cases."""


@dataclass(frozen=True)
class File:
    """A rig file or a record.

    Attributes
    ----------
    name, role : str
    size : int or None
        Bytes; None where nothing was read.
    sha256 : str
        The first digits, of what was read; why there are none otherwise.
    """

    name: str
    role: str
    size: int | None
    sha256: str


def files_of(diagnosis: Diagnosis) -> list[File]:
    """Rig files, records and records for validation, each once."""
    return list(dict.fromkeys(_file(*found) for found in _named(diagnosis)))


def _named(diagnosis: Diagnosis) -> Iterator[tuple[str, str, Path | None, Provenance | None]]:
    for rig in (diagnosis.model.rig, *diagnosis.model.points):
        yield rig.name, "rig", rig.path, rig.provenance
    for role, records in (("record", diagnosis.records), ("validation", diagnosis.validation)):
        for record in records:
            yield record.name, role, record.path, record.provenance


def _file(name: str, role: str, path: Path | None, read: Provenance | None) -> File:
    if read is None or path is None:
        return File(name if path is None else path.name, role, None, "made in memory, read from no file")
    return File(path.name, role, read.size, read.sha256[:SHORT])
