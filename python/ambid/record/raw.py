"""Signals out of the arrays of a file that keeps to the names and units of a record."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.channels import FURTHER, SIGNALS
from ambid.errors import RecordError
from ambid.findings import Finding
from ambid.record.content import (
    COLUMNS_NOT_USED,
    TRANSPOSED,
    VARIABLES_NOT_USED,
    Content,
    NotNumbers,
    Stored,
    aligned,
    require_names,
    require_unique,
    unused,
)

OF_LOOP = ("i_e", "r", "y", "i_c", "i_ref")
"""Signals that a record has of every axis, if at all."""
OF_AXES = tuple(f"{signal}." for signal in SIGNALS)
"""What the names of columns begin with."""
OF_FURTHER = tuple(f"{signal}." for signal in FURTHER)
AT_SENSORS = {name for name in FURTHER if "axis" not in SIGNALS[name].at}
"""Signals of sensors of their own, which show the motion where y was not recorded."""
APART = "further"
"""Structure of a .mat file that holds single channels, such as ``further.a.drive_end``."""
NAMES = "rename them, or give a map of them: t=COLUMN, y.A_zeta=COLUMN:FACTOR, ..."
"""What to do about a file with names of its own."""
RATE = "give the sample rate [Hz] (--sample-rate)"
"""What to do about a file whose time is not in s."""


Signals = dict[str, NDArray[np.float64]]
"""What was recorded, by name: signals of shape (N, n), and further channels of shape (N, 1)."""


@dataclass
class RawRecord:
    """What a file holds, before any check of its values.

    `signals` maps a name of `SIGNALS` to the axis names of its columns (None: the file does not say) and an array
    (N, axes); `further` has single channels, such as ``b.A_zeta``, by name; `t` [s] and `sample_rate` [Hz] are None
    where the file lacks them.
    """

    signals: dict[str, tuple[tuple[str, ...] | None, NDArray[np.float64]]]
    t: NDArray[np.float64] | None = None
    sample_rate: float | None = None
    findings: list[Finding] = field(default_factory=list)
    further: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def gather(self, columns: Mapping[str, NDArray[np.float64]]) -> None:
        """Take columns such as ``y.A_zeta`` and ``b.A_zeta``, shape (N,) each; others are passed over."""
        for signal in OF_LOOP:
            own = [name for name in columns if name.startswith(f"{signal}.")]
            if own:
                axes = tuple(name.removeprefix(f"{signal}.") for name in own)
                self.signals[signal] = (axes, np.stack([columns[name] for name in own], axis=1))
        self.further = {name: column for name, column in columns.items() if name.startswith(OF_FURTHER)}


def raw_record(path: Path, content: Content, sample_rate: float | None = None) -> RawRecord:
    """Make signals of what a file holds.

    Parameters
    ----------
    path : Path
        For the messages.
    content : Content
        Columns ``t``, ``i_e.<axis>``, ``y.<axis>``, ...; or arrays ``fs``, ``t``, ``i_e``, ``y``, ... (N x axes) and
        ``axes``.
    sample_rate : float, optional
        Of a file that states none [Hz].

    Raises
    ------
    RecordError
        If y, or both t and the sample rate, are missing, or something is not an array of numbers of the right shape.
    """
    has_columns = any(name.startswith(tuple(f"{signal}." for signal in OF_LOOP)) for name in content.arrays)
    gather = _from_columns if content.is_table or has_columns else _from_matrices
    raw = gather(path, content, sample_rate)
    raw.findings += content.findings
    if raw.sample_rate is None:
        raw.sample_rate = sample_rate
    require_agreement(path, raw.sample_rate, sample_rate)
    return raw


def lacks_motion(names: Iterable[str]) -> bool:
    """Whether columns or variables hold neither y, nor what sensors of their own read beside a signal of the axes."""
    signals = {name.removeprefix(f"{APART}.").partition(".")[0] for name in names}
    return "y" not in signals and not (signals & AT_SENSORS and signals & set(OF_LOOP))


def require_agreement(path: Path, in_file: float | None, given: float | None) -> None:
    """Refuse a sample rate that contradicts what the file states."""
    if in_file is not None and given is not None and abs(in_file / given - 1.0) > 1e-3:
        raise RecordError(f"{path}: the file states {in_file:g} Hz, {given:g} Hz was given; leave out the wrong one")


def numbers(path: Path, name: str, value: Any) -> NDArray[np.float64]:
    """An array of real numbers; RecordError where it is none, or empty."""
    if isinstance(value, NotNumbers):
        what, remedy = "not a number", "correct the cell"
        if value.is_clock:
            what = "a time of day, not a number"
            remedy += (
                f", or, if it is the time of the samples, rename the column or leave it out of the map, and {RATE}"
            )
        raise RecordError(f"{path}: {name}, row {value.row}: {value.cell!r} is {what}; {remedy}")
    array = value if isinstance(value, Stored) else np.asarray(value)
    if array.dtype.kind not in "iufb" or 0 in array.shape:
        raise RecordError(f"{path}: {name} holds {array.dtype} of shape {array.shape}; give real numbers")
    return np.asarray(array, dtype=np.float64)


def _from_columns(path: Path, content: Content, sample_rate: float | None) -> RawRecord:
    """Gather columns t, i_e.<axis>, y.<axis>, ... into signals."""
    require_names(path, content.has_names)
    named = {name: name for name in content.arrays} | content.aliases
    own = {name: at for name, at in named.items() if name == "t" or name.startswith(OF_AXES)}
    own = {name: own[name] for name in sorted(own, key=lambda name: name != "t")}
    for name in filter(lambda name: name.startswith(OF_AXES), content.shared):
        require_unique(path, name, name, content.shared)
    for name in content.arrays:
        base = re.sub(r"\s*[\[(].*[\])]$", "", name)
        if base != name and (base == "t" and "t" not in own and sample_rate is None or base.startswith(OF_AXES)):
            raise RecordError(
                f"{path}: {name}: units in names of columns are not read; rename it to {base} and give SI units, or "
                f"map every column with its factor, such as {base}={name}:FACTOR"
            )
    values = {name: numbers(path, name, content.arrays[at]).ravel() for name, at in own.items()}
    timing = {name: content.timing[at] for name, at in own.items() if at in content.timing}
    found = aligned(path, values, timing)
    lengths = {name: len(array) for name, array in found.values.items() if name != "t"}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise RecordError(f"{path}: the columns have different lengths ({listed}); give one value a sample")
    raw = RawRecord({}, found.values.get("t"), found.sample_rate, found.findings)
    raw.gather(found.values)
    columns, used = content.arrays, {"t", "fs", *own.values()}
    present = ", ".join(columns)
    if raw.t is None and raw.sample_rate is None and sample_rate is None:
        clocks = [name for name, one in columns.items() if isinstance(one, NotNumbers) and one.is_clock]
        remedy = f"{clocks[0]} holds times of day, not s: {RATE}" if clocks else f"{NAMES}; or {RATE}"
        raise RecordError(f"{path}: column 't' [s] is missing; the columns are {present}; {remedy}")
    if lacks_motion(own):
        raise RecordError(f"{path}: no column 'y.<axis>' (displacement [m]); the columns are {present}; {NAMES}")
    raw.findings += unused(COLUMNS_NOT_USED, (name for name in columns if name not in used))
    return raw


def _from_matrices(path: Path, content: Content, sample_rate: float | None) -> RawRecord:
    """Gather arrays fs, t, i_e, y, ... (N x axes) into signals; an array axes x N is turned, with a finding."""
    values = content.arrays
    of_axes = None if content.axes is None else _axis_names(path, content.axes)
    present = ", ".join(values)
    if lacks_motion(values):
        raise RecordError(
            f"{path}: variable 'y' (displacement [m], N x axes) is missing; the variables are {present}; {NAMES}, "
            "where column k of a matrix M is M[k]"
        )
    if "fs" not in values and "t" not in values and sample_rate is None:
        raise RecordError(f"{path}: neither 'fs' [Hz] nor 't' [s] is there; add one. The variables are {present}")
    own = ("fs", "t", *SIGNALS)
    arrays = {name: numbers(path, name, values[name]) for name in own if name in values}
    raw = RawRecord({}, arrays["t"].ravel() if "t" in arrays else None)
    if "fs" in arrays:
        if arrays["fs"].size != 1:
            raise RecordError(f"{path}: fs has {arrays['fs'].size} values; give one sample rate [Hz]")
        raw.sample_rate = float(arrays["fs"].item())
    for signal in SIGNALS:
        if signal not in arrays:
            continue
        array = arrays[signal].reshape(-1, 1) if arrays[signal].ndim == 1 else arrays[signal]
        axes = of_axes if "axis" in SIGNALS[signal].at else None
        if array.ndim != 2:
            raise RecordError(f"{path}: {signal} has the shape {array.shape}; give N x axes")
        wide = array.shape[0] == 1 or (raw.t is not None and array.shape[1] == len(raw.t) != array.shape[0])
        if array.shape[0] == len(axes) != array.shape[1] if axes is not None else wide and array.shape[1] > 1:
            array = array.T
            raw.findings.append(TRANSPOSED(name=signal))
        if axes is not None and array.shape[1] != len(axes):
            raise RecordError(
                f"{path}: {signal} has the shape {array.shape}, 'axes' names {len(axes)} ({', '.join(axes)}); "
                "make it N x axes"
            )
        raw.signals[signal] = (axes, array)
    single = {at: at.removeprefix(f"{APART}.") for at in values if at.startswith((f"{APART}.", *OF_FURTHER))}
    raw.further = {name: numbers(path, at, values[at]).ravel() for at, name in single.items()}
    used = {"axes", *own, *single}
    raw.findings += unused(VARIABLES_NOT_USED, (name for name in values if name not in used))
    return raw


def _axis_names(path: Path, cells: list[Any]) -> tuple[str, ...]:
    names = [cell.decode() if isinstance(cell, bytes) else cell for cell in cells]
    if not names or not all(isinstance(name, str) for name in names):
        raise RecordError(f"{path}: 'axes' is not a list of names; save a cell array such as {{'A_zeta', 'A_eta'}}")
    return tuple(name.strip() for name in names)
