"""The files that a diagnosis was made of, with what tells whether somebody else holds the same ones."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ambid.diagnosis import Diagnosis

SHORT = 16
"""Hexadecimal digits of a hash that are shown: two different files share them by chance in one of 2e19 cases."""


@dataclass(frozen=True)
class File:
    """A rig file or a record.

    Attributes
    ----------
    name, role : str
    size : int or None
        Bytes; None where there is no file.
    sha256 : str
        The first digits; why there are none, where the file cannot be read.
    """

    name: str
    role: str
    size: int | None
    sha256: str


def files_of(diagnosis: Diagnosis) -> list[File]:
    """Rig files, records and records for validation, each once."""
    return list(dict.fromkeys(_file(*found) for found in _named(diagnosis)))


def _named(diagnosis: Diagnosis) -> Iterator[tuple[str, str, Path | None]]:
    for rig in (diagnosis.model.rig, *diagnosis.model.points):
        yield rig.name, "rig", rig.path
    for role, records in (("record", diagnosis.records), ("validation", diagnosis.validation)):
        for record in records:
            yield record.name, role, record.path


def _file(name: str, role: str, path: Path | None) -> File:
    if path is None:
        return File(name, role, None, "made in memory, in no file")
    try:
        with path.open("rb") as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()
            return File(path.name, role, stream.tell(), found[:SHORT])
    except OSError as error:
        return File(path.name, role, None, f"no longer readable ({error.strerror})")
