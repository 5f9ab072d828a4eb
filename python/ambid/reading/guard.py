"""A file that is read: whatever its parser raises becomes an error that names it, and its bytes have a hash.

Later changes of the file do not matter.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ambid.errors import AmbidError, InputError

__all__ = ["Provenance", "reading", "watched"]


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
