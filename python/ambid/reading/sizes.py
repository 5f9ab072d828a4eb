"""How much may be read: what a file declares is held against the memory and against what it stores."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

from ambid.errors import RecordError

__all__ = ["MOST_COLUMNS", "most_bytes", "require_size"]

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
