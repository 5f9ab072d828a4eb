"""What a file of a record holds, before anything is made of it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from ambid.errors import RecordError
from ambid.findings import REMARK, Finding, Kind
from ambid.reading import MOST_COLUMNS, Provenance
from ambid.record.timing import Timing

COLUMNS_NOT_USED = Kind("columns_not_used", "note", "columns not used: {names}")
VARIABLES_NOT_USED = Kind("variables_not_used", "note", "variables not used: {names}")
CHANNELS_NOT_USED = Kind("channels_not_used", "note", "channels not used: {names}")
TRANSPOSED = Kind("matrix_transposed", "note", "{name} is stored as axes x N and was transposed")


@dataclass(frozen=True)
class Stored:
    """An array in an open file, which is read when NumPy asks for it, and not before.

    Attributes
    ----------
    shape : tuple of int
    dtype : dtype
    read : function
        Checks the size, and returns the array.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[], NDArray[Any]]

    @cached_property
    def values(self) -> NDArray[Any]:
        """What was read, once for all columns of a matrix."""
        return self.read()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self.values, dtype=dtype)


@dataclass(frozen=True)
class NotNumbers:
    """A column of a table with a cell that is no number: text, the time of day, or nothing.

    Attributes
    ----------
    shape : tuple of int
    row : int
        Of the first such cell, counted from 1.
    cell : str
    """

    shape: tuple[int, ...]
    row: int
    cell: str
    dtype: ClassVar[np.dtype[Any]] = np.dtype(object)


@dataclass
class Content:
    """What a file holds, before anything is made of it.

    Attributes
    ----------
    arrays : dict of str to array, Stored or NotNumbers
        By name, in the file's order: columns of a table, variables, datasets. Members of groups and structures have
        names such as ``scope/y`` (HDF5, TDMS) or ``scope.y`` (.mat).
    is_table : bool
        Whether the format has columns only.
    axes : list, optional
        Entries of a variable ``axes``.
    aliases : dict of str to str
        Further names of arrays, such as those of TDMS channels without their group where that is unique.
    timing : dict of str to Timing
        Of the arrays for which the format itself states it, as TDMS does.
    has_names : bool
        False where the columns have no names and are called 1, 2, ...
    findings : list of Finding
        What was left out or interpreted.
    provenance : Provenance, optional
        Of the file.
    """

    arrays: dict[str, Any]
    is_table: bool = False
    axes: list[Any] | None = None
    aliases: dict[str, str] = field(default_factory=dict)
    timing: dict[str, Timing] = field(default_factory=dict)
    has_names: bool = True
    findings: list[Finding] = field(default_factory=list)
    provenance: Provenance | None = None


def require_columns(path: Path, count: int) -> None:
    """Refuse a table on its side."""
    if count > MOST_COLUMNS:
        raise RecordError(f"{path}: {count} columns, at most {MOST_COLUMNS} are read; give one a channel")


def require_names(path: Path, has_names: bool) -> None:
    """Refuse a table without names of its columns."""
    if not has_names:
        raise RecordError(f"{path}: the first line holds numbers; put the names of the columns above them")


def unused(kind: Kind, names: Iterable[str]) -> list[Finding]:
    """A finding on columns, variables or channels that nothing is read from; none where there are none."""
    own = list(names)
    return [kind(names=own)] if own else []


def remarks(notes: Iterable[str]) -> list[Finding]:
    """Findings of the deprecated argument `notes`, a line each."""
    own = [REMARK(text=text) for text in notes]
    if own:
        warn(
            "notes is deprecated and goes in 1.0; give findings, such as REMARK(text=...)",
            DeprecationWarning,
            stacklevel=3,
        )
    return own
