"""The bytes that something was read from, identified by their hash: later changes of the file do not matter."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ambid.errors import InputError

__all__ = ["Provenance", "watched"]


@dataclass(frozen=True)
class Provenance:
    """The content of a file as it was read.

    Attributes
    ----------
    sha256 : str
        Hexadecimal.
    size : int
        Bytes.
    """

    sha256: str
    size: int

    @classmethod
    def of(cls, content: bytes) -> Provenance:
        """Of what was read as a whole."""
        return cls(hashlib.sha256(content).hexdigest(), len(content))


@contextmanager
def watched(path: Path, error: type[InputError]) -> Iterator[Provenance]:
    """Read a file within, by whatever opens it: what it holds, and that it stays the same until it is read.

    Parameters
    ----------
    path : Path
    error : type of InputError
        To raise.

    Raises
    ------
    error
        If the file was written or replaced meanwhile.
    """
    with path.open("rb") as stream:
        before = _mark(os.fstat(stream.fileno()))
        found = Provenance(hashlib.file_digest(stream, "sha256").hexdigest(), stream.tell())
    yield found
    if _mark(path.stat()) != before:
        raise error(f"{path}: was written while it was read; wait until it is whole, and read it again")


def _mark(status: os.stat_result) -> tuple[int, int, int]:
    return status.st_ino, status.st_size, status.st_mtime_ns
