"""A file that is read: whatever its parser raises becomes an error that names it, and its bytes have a hash.

Later changes of the file do not matter. What it declares is held against the memory, and against what it stores.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ambid.errors import AmbidError, InputError, RecordError

SHARE_OF_MEMORY = 0.25
"""That one array of a file may take: a record has some three, and a fit needs as much again."""
LARGEST = 1 << 29
"""Bytes of one array on any machine: 16 million samples of four axes, more than a fit of hours takes."""
MOST_COMPRESSED = 1100
"""Bytes that one stored byte may stand for: deflate makes 1032 of one at most, so that more is a damaged size."""
SMALL = 1 << 24
"""Bytes that are read whatever is stored for them: 16 MiB swell nothing."""
MOST_COLUMNS = 10_000
"""Columns, variables or channels of a file; loggers write hundreds, and a table on its side has more."""


@contextmanager
def reading(path: str | Path, error: type[InputError], what: str, remedy: str) -> Iterator[None]:
    """Read a file within: errors of our own pass, all others become one that names the file.

    A damaged byte leads a parser to any exception at all, so that none can be listed here.

    Parameters
    ----------
    path : str or Path
    error : type of InputError
        To raise.
    what : str
        That the file should be, such as ``a readable .mat file``.
    remedy : str
        What to do.

    Raises
    ------
    error
    """
    try:
        yield
    except AmbidError:
        raise
    except MemoryError:
        raise error(f"{path}: does not fit into memory; cut it, or read it on a larger machine") from None
    except RecursionError:
        raise error(f"{path}: not {what} (nested too deeply); {remedy}") from None
    except OSError as found:
        if found.filename is not None:
            raise error(f"{path}: cannot be read ({found.strerror}); check the path") from None
        raise error(f"{path}: not {what} ({found}); {remedy}") from found
    except Exception as found:
        raise error(f"{path}: not {what} ({type(found).__name__}: {found}); {remedy}") from found


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


def most_bytes() -> int:
    """Bytes that one array of a file may have here: less where the machine, or this process, has little memory."""
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit

        allowed = getrlimit(RLIMIT_AS)[0]
    except (AttributeError, ImportError, OSError, ValueError):  # not a Unix
        return LARGEST
    memory = memory if allowed == RLIM_INFINITY else min(memory, allowed)
    return min(LARGEST, int(SHARE_OF_MEMORY * memory))


def require_size(path: Path, name: str, shape: Sequence[int], itemsize: int, stored: int | None = None) -> None:
    """Refuse an array before it is read, if it is too large or larger than what is stored for it can be.

    Parameters
    ----------
    path : Path
    name : str
        Of the array.
    shape : sequence of int
        As the file declares it.
    itemsize : int
        Bytes of an entry.
    stored : int, optional
        Bytes that the file holds for it.

    Raises
    ------
    RecordError
    """
    declared, most = math.prod(shape) * itemsize, most_bytes()
    if declared > most:
        raise RecordError(
            f"{path}: {name} declares the shape {tuple(shape)}, {declared:.3g} bytes; at most {most:.3g} are read; "
            "cut the record, or save it again if the shape is wrong"
        )
    if stored is not None and declared > max(SMALL, MOST_COMPRESSED * stored):
        raise RecordError(
            f"{path}: {name} declares the shape {tuple(shape)}, {declared:.3g} bytes, and {stored} are stored for it; "
            "the file is damaged or was never filled: save it again"
        )
