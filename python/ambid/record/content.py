"""What a file of a record holds, before anything is made of it; channels that begin at instants of their own."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.errors import RecordError
from ambid.findings import REMARK, Finding, Kind
from ambid.reading import MOST_COLUMNS, Provenance

COLUMNS_NOT_USED = Kind("columns_not_used", "note", "columns not used: {names}")
VARIABLES_NOT_USED = Kind("variables_not_used", "note", "variables not used: {names}")
CHANNELS_NOT_USED = Kind("channels_not_used", "note", "channels not used: {names}")
TRANSPOSED = Kind("matrix_transposed", "note", "{name} is stored as axes x N and was transposed")
CHANNELS_ALIGNED = Kind(
    "channels_aligned",
    "note",
    "channels aligned by their start times ({start_s:.9g} s after the first): {samples} samples are common to all",
)
CHANNELS_APART = Kind(
    "channels_apart",
    "warning",
    "start times put channels between the samples of {reference}: {late_s:.4g|us}, in samples {late_samples:.3g}; "
    "they are aligned to the nearest sample, and not interpolated",
    "sample all channels at one instant, or see whether sampling_skew explains the misfit",
)
SAME_INSTANT = 0.01
"""Part of a sample by which channels may differ that are sampled at one instant: files state whole microseconds."""


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

    @property
    def is_clock(self) -> bool:
        """Whether the cell is a time of day."""
        return re.search(r"\d:\d\d", self.cell) is not None


@dataclass(frozen=True)
class Timing:
    """What a file states of the instants of one channel.

    Attributes
    ----------
    increment : float or None
        Sample time [s].
    start : float or None
        Instant of the first sample, after an origin that the channels of a file share [s].
    """

    increment: float | None = None
    start: float | None = None


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
    shared : dict of str to list of str
        Names that several groups have, with the arrays of each.
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
    shared: dict[str, list[str]] = field(default_factory=dict)
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


def require_unique(path: Path, channel: str, name: str, shared: Mapping[str, Sequence[str]]) -> None:
    """Refuse a name that several groups have."""
    if name in shared:
        raise RecordError(
            f"{path}: {name} is ambiguous: the file has {' and '.join(shared[name])}; map the channels, such as "
            f"{channel}={shared[name][0]}"
        )


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


@dataclass(frozen=True)
class Aligned:
    """Channels at common instants, their sample rate [Hz] if it is stated, and what was noticed."""

    values: dict[str, FloatArray]
    sample_rate: float | None
    findings: list[Finding]


def aligned(path: Path, values: Mapping[str, FloatArray], timing: Mapping[str, Timing]) -> Aligned:
    """Put channels side by side: sample k of each is taken at the same instant, to half a sample.

    Channels that begin at other instants lose what is not common to all. Fractions of a sample stay, with a warning:
    interpolation would change the response of the loop.

    Parameters
    ----------
    path : Path
        For the messages.
    values : mapping of str to ndarray
        By channel, such as ``y.A_zeta``.
    timing : mapping of str to Timing
        Of those channels for which the file states it.

    Raises
    ------
    RecordError
        If the channels have several sample times, share no instant, or some state their start and others do not.
    """
    own = {name: timing[name] for name in values if name in timing}
    rate = _common_rate(path, own)
    starts = {name: at.start for name, at in own.items() if at.start is not None}
    if rate is None or not starts:
        return Aligned(dict(values), rate, [])
    reference = next((name for name in starts if name.startswith("y.")), next(iter(starts)))
    after = {name: (start - starts[reference]) * rate for name, start in starts.items()}
    whole = {name: round(samples) for name, samples in after.items()}
    unknown = [name for name in values if name not in starts]
    if unknown and any(whole.values()):
        latest, earliest = max(after, key=after.__getitem__), min(after, key=after.__getitem__)
        apart = starts[latest] - starts[earliest]
        raise RecordError(
            f"{path}: {latest} starts {apart:.6g} s after {earliest}, and {unknown[0]} states no start time "
            "(wf_start_time); state it for every channel, or for none"
        )
    findings: list[Finding] = []
    late = {name: after[name] - whole[name] for name in starts if abs(after[name] - whole[name]) > SAME_INSTANT}
    if late:
        seconds = {name: samples / rate for name, samples in late.items()}
        findings.append(CHANNELS_APART(reference=reference, channels=list(late), late_s=seconds, late_samples=late))
    lengths = {name: len(array) for name, array in values.items()}
    if not any(whole.values()) and (unknown or len(set(lengths.values())) == 1):
        return Aligned(dict(values), rate, findings)
    first = max(whole.values())
    last = min(whole[name] + lengths[name] for name in whole)
    if last <= first:
        latest = max(whole, key=whole.__getitem__)
        ends = min(whole, key=lambda name: whole[name] + lengths[name])
        raise RecordError(
            f"{path}: {latest} starts {(whole[latest] - whole[ends]) / rate:.6g} s after {ends}, which has "
            f"{lengths[ends]} samples: no instant is common to all channels; export channels of one recording"
        )
    begin = min(starts.values())
    since = {name: start - begin for name, start in starts.items()}
    findings.append(CHANNELS_ALIGNED(start_s=since, samples=last - first))
    kept = {name: array[first - whole[name] : last - whole[name]] for name, array in values.items()}
    return Aligned(kept, rate, findings)


def _common_rate(path: Path, timing: Mapping[str, Timing]) -> float | None:
    """Sample rate of all channels that state one [Hz]."""
    steps = {name: at.increment for name, at in timing.items() if at.increment is not None}
    if not steps:
        return None
    one = next(iter(steps.values()))
    # relative difference of two sample times that is rounding: a sample over a billion
    if any(abs(step / one - 1.0) > 1e-9 for step in steps.values()):
        listed = ", ".join(f"{name} {step:.9g} s" for name, step in steps.items())
        raise RecordError(
            f"{path}: the channels have different sample times, wf_increment: {listed}; export them at one rate, or "
            "map channels of one"
        )
    return float(np.float64(1.0) / one)
