"""The file formats of records: CSV, MATLAB (v5 and v7.3), HDF5 and Parquet, read into and written from plain arrays."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from ambid.errors import InputError, RecordError

if TYPE_CHECKING:
    from ambid.record import Record

SIGNALS = ("i_e", "y", "i_c", "i_ref")
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"


@dataclass
class RawRecord:
    """What a file holds, before any check of its values.

    `signals` maps a name of `SIGNALS` to the axis names of its columns (None: the file does not say) and an array
    (N, axes); `t` [s] and `sample_rate` [Hz] are None where the file lacks them.
    """

    signals: dict[str, tuple[tuple[str, ...] | None, NDArray[np.float64]]]
    t: NDArray[np.float64] | None = None
    sample_rate: float | None = None
    notes: list[str] = field(default_factory=list)


def read(path: Path) -> RawRecord:
    """Read a record in the format that the suffix of its path names.

    Raises
    ------
    RecordError
        If the file is missing, empty, damaged, of an unknown suffix, or lacks y or t.
    InputError
        If the format needs a package that is not installed.
    """
    reader = _by_suffix(path, _READERS)
    require_content(path)
    return reader(path)


def write(record: Record, path: Path) -> None:
    """Write a record in the format that the suffix of the path names, with the names that `read` expects.

    Raises
    ------
    RecordError
        If the suffix is unknown.
    InputError
        If the format needs a package that is not installed.
    """
    _by_suffix(path, _WRITERS)(record, path)


def _by_suffix(path: Path, functions: dict[str, Callable[..., Any]]) -> Callable[..., Any]:
    suffix = path.suffix.lower()
    if suffix not in functions:
        allowed = ", ".join(functions)
        raise RecordError(f"{path}: suffix {suffix!r} is not a record format; use one of {allowed}")
    return functions[suffix]


def require_content(path: Path) -> None:
    """Raise RecordError unless the path is a file with something in it."""
    if not path.is_file():
        raise RecordError(f"{path}: there is no such file; check the path")
    if path.stat().st_size == 0:
        raise RecordError(f"{path}: the file is empty; record it again")


def read_csv_columns(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read a comma-separated table with one header line into its columns, by name.

    Raises
    ------
    RecordError
        For a duplicated column, a header without rows, or a cell that is not a number (with its row, counted from 1).
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            names = [name.strip() for name in file.readline().split(",")]
            lines = [line for line in file if line.strip()]
    except UnicodeDecodeError:
        raise RecordError(f"{path}: not a text file; give comma-separated text in UTF-8") from None
    if all(_is_number(name) for name in names):
        raise RecordError(f"{path}: the first line holds numbers; put the names of the columns above them")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise RecordError(f"{path}: column {twice[0]!r} is there {Counter(names)[twice[0]]} times; keep one")
    if not lines:
        raise RecordError(f"{path}: a header without rows; record it again")
    try:
        table = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except ValueError as error:
        raise RecordError(f"{path}: {_first_bad_cell(lines, names) or error}") from None
    if table.shape[1] != len(names):
        raise RecordError(f"{path}: {len(names)} names in the header, {table.shape[1]} columns below; make them equal")
    return dict(zip(names, table.T, strict=True))


def _first_bad_cell(lines: list[str], names: list[str]) -> str | None:
    """Name the first cell that is no number, or the first row of a wrong length."""
    for row, line in enumerate(lines, start=1):
        cells = line.rstrip("\n").split(",")
        if len(cells) != len(names):
            return f"row {row} has {len(cells)} cells, the header {len(names)}; complete or remove the row"
        for name, cell in zip(names, cells, strict=True):
            if not _is_number(cell):
                return f"{name}, row {row}: {cell.strip()!r} is not a number; correct the cell"
    return None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _from_columns(path: Path, columns: dict[str, NDArray[np.float64]]) -> RawRecord:
    """Gather columns t, i_e.<axis>, y.<axis>, ... into signals."""
    signals: dict[str, tuple[tuple[str, ...] | None, NDArray[np.float64]]] = {}
    used = {"t", "fs"}
    for signal in SIGNALS:
        own = [name for name in columns if name.startswith(f"{signal}.")]
        if own:
            axes = tuple(name.removeprefix(f"{signal}.") for name in own)
            signals[signal] = (axes, np.stack([columns[name] for name in own], axis=1))
            used.update(own)
    present = ", ".join(columns)
    if "t" not in columns:
        raise RecordError(f"{path}: column 't' [s] is missing; the columns are {present}")
    if "y" not in signals:
        raise RecordError(f"{path}: no column 'y.<axis>' (displacement [m]); the columns are {present}")
    raw = RawRecord(signals, columns["t"])
    unused = [name for name in columns if name not in used]
    if unused:
        raw.notes.append(f"columns not used: {', '.join(unused)}")
    return raw


def _from_matrices(path: Path, values: dict[str, Any], axes: tuple[str, ...] | None) -> RawRecord:
    """Gather arrays fs, t, i_e, y, ... (N x axes) into signals; an array axes x N is turned, with a note."""
    present = ", ".join(values)
    if "y" not in values:
        raise RecordError(f"{path}: variable 'y' (displacement [m], N x axes) is missing; the variables are {present}")
    if "fs" not in values and "t" not in values:
        raise RecordError(f"{path}: neither 'fs' [Hz] nor 't' [s] is there; add one. The variables are {present}")
    arrays = {name: _numbers(path, name, values[name]) for name in ("fs", "t", *SIGNALS) if name in values}
    raw = RawRecord({}, arrays["t"].ravel() if "t" in arrays else None)
    if "fs" in arrays:
        if arrays["fs"].size != 1:
            raise RecordError(f"{path}: fs has {arrays['fs'].size} values; give one sample rate [Hz]")
        raw.sample_rate = float(arrays["fs"].item())
    for signal in SIGNALS:
        if signal not in arrays:
            continue
        array = arrays[signal].reshape(-1, 1) if arrays[signal].ndim == 1 else arrays[signal]
        if array.ndim != 2:
            raise RecordError(f"{path}: {signal} has the shape {array.shape}; give N x axes")
        if axes is not None and array.shape[0] == len(axes) != array.shape[1]:
            array = array.T
            raw.notes.append(f"{signal} is stored as axes x N and was transposed")
        if axes is not None and array.shape[1] != len(axes):
            raise RecordError(
                f"{path}: {signal} has the shape {array.shape}, 'axes' names {len(axes)} ({', '.join(axes)}); "
                "make it N x axes"
            )
        raw.signals[signal] = (axes, array)
    unused = [name for name in values if name not in ("fs", "t", "axes", *SIGNALS)]
    if unused:
        raw.notes.append(f"variables not used: {', '.join(unused)}")
    return raw


def _numbers(path: Path, name: str, value: Any) -> NDArray[np.float64]:
    array = np.asarray(value)
    if array.dtype.kind not in "iufb" or array.size == 0:
        raise RecordError(f"{path}: {name} holds {array.dtype} of shape {array.shape}; give real numbers")
    return array.astype(np.float64)


def _read_csv(path: Path) -> RawRecord:
    return _from_columns(path, read_csv_columns(path))


def _read_mat(path: Path) -> RawRecord:
    with path.open("rb") as file:
        head = file.read(520)
    # MATLAB puts a block of 512 bytes before the HDF5 signature of a v7.3 file.
    if _HDF5_SIGNATURE in (head[:8], head[512:]):
        return _read_hdf5(path)
    try:
        content = scipy.io.loadmat(path)
    except Exception as error:  # the parser raises whatever a damaged byte leads it to
        raise RecordError(f"{path}: not a readable .mat file ({error}); save it again as v5 or v7.3") from error
    values = {name: value for name, value in content.items() if not name.startswith("__")}
    axes = values.get("axes")
    return _from_matrices(path, values, None if axes is None else _axis_names(path, _flatten_cells(axes)))


def _read_hdf5(path: Path) -> RawRecord:
    h5py = _extra("h5py", path)
    try:
        with h5py.File(path, "r") as file:
            datasets = {name: item for name, item in file.items() if isinstance(item, h5py.Dataset)}
            # MATLAB stores column by column: its arrays are turned in HDF5's view.
            values = {
                name: item[()].T if "MATLAB_class" in item.attrs or path.suffix.lower() == ".mat" else item[()]
                for name, item in datasets.items()
            }
            axes = _hdf5_strings(file, datasets["axes"]) if "axes" in datasets else None
    except OSError as error:
        raise RecordError(f"{path}: not a readable HDF5 file ({error}); save it again") from error
    if any("." in name for name in values):
        return _from_columns(path, {name: _numbers(path, name, value).ravel() for name, value in values.items()})
    return _from_matrices(path, values, None if axes is None else _axis_names(path, axes))


def _read_parquet(path: Path) -> RawRecord:
    parquet = _extra("pyarrow.parquet", path)
    try:
        table = parquet.read_table(path)
    except (OSError, ValueError) as error:
        raise RecordError(f"{path}: not a readable Parquet file ({error}); save it again") from error
    columns = {name: table[name].to_numpy() for name in table.column_names}
    return _from_columns(path, {name: _numbers(path, name, value) for name, value in columns.items()})


def _extra(module: str, path: Path) -> ModuleType:
    """Import an optional package, or say how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise InputError(f"{path}: this format needs the package {package}: pip install 'ambid[io]'") from None


def _flatten_cells(axes: NDArray[Any]) -> list[Any]:
    """Strings of a MATLAB cell array or char matrix as SciPy returns it."""
    return [cell.item() if isinstance(cell, np.ndarray) and cell.size == 1 else cell for cell in np.ravel(axes)]


def _hdf5_strings(file: Any, dataset: Any) -> list[Any]:
    """Strings of an HDF5 string array, or of a MATLAB v7.3 cell array (references to rows of character codes)."""
    if dataset.dtype.kind == "O" and dataset.attrs.get("MATLAB_class", b"cell") == b"cell":
        cells = np.ravel(dataset[()])
        return ["".join(map(chr, np.ravel(file[cell][()]))) if not isinstance(cell, bytes) else cell for cell in cells]
    if dataset.dtype.kind == "u":
        return ["".join(map(chr, row)) for row in np.atleast_2d(dataset[()].T)]
    return list(np.ravel(dataset[()]))


def _axis_names(path: Path, cells: list[Any]) -> tuple[str, ...]:
    names = [cell.decode() if isinstance(cell, bytes) else cell for cell in cells]
    if not names or not all(isinstance(name, str) for name in names):
        raise RecordError(f"{path}: 'axes' is not a list of names; save a cell array such as {{'A_zeta', 'A_eta'}}")
    return tuple(name.strip() for name in names)


def _columns(record: Record) -> dict[str, NDArray[np.float64]]:
    columns = {"t": record.t}
    for signal, array in _signals(record).items():
        columns |= {f"{signal}.{axis}": array[:, j] for j, axis in enumerate(record.axes)}
    return columns


def _signals(record: Record) -> dict[str, NDArray[np.float64]]:
    return {signal: getattr(record, signal) for signal in SIGNALS if getattr(record, signal) is not None}


def _write_csv(record: Record, path: Path) -> None:
    columns = _columns(record)
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


def _write_mat(record: Record, path: Path) -> None:
    axes = np.array(record.axes, dtype=object).reshape(-1, 1)
    content = {"fs": record.sample_rate, "t": record.t.reshape(-1, 1), **_signals(record), "axes": axes}
    scipy.io.savemat(path, content, do_compression=True)


def _write_hdf5(record: Record, path: Path) -> None:
    h5py = _extra("h5py", path)
    with h5py.File(path, "w") as file:
        for name, value in {"fs": record.sample_rate, "t": record.t, **_signals(record)}.items():
            file[name] = value
        file["axes"] = list(record.axes)


def _write_parquet(record: Record, path: Path) -> None:
    parquet = _extra("pyarrow.parquet", path)
    parquet.write_table(_extra("pyarrow", path).table(_columns(record)), path)


_READERS: dict[str, Callable[[Path], RawRecord]] = {
    ".csv": _read_csv,
    ".mat": _read_mat,
    ".h5": _read_hdf5,
    ".hdf5": _read_hdf5,
    ".parquet": _read_parquet,
}
_WRITERS: dict[str, Callable[[Record, Path], None]] = {
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".parquet": _write_parquet,
}
