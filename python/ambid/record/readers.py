"""The file formats of records, CSV, MATLAB (v5 and v7.3), HDF5, Parquet and TDMS, read into named arrays."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from ambid.errors import InputError, RecordError

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MATLAB_OWN = ("#refs#", "#subsystem#")


@dataclass
class Content:
    """What a file holds, before anything is made of it.

    Attributes
    ----------
    arrays : dict of str to array
        By name, in the file's order: columns of a table, variables, datasets. Members of groups and structures have
        names such as ``scope/y`` (HDF5, TDMS) or ``scope.y`` (.mat).
    is_table : bool
        Whether the format has columns only.
    axes : list, optional
        Entries of a variable ``axes``.
    sample_rate : float, optional
        What the format itself states [Hz], as TDMS does.
    has_names : bool
        False where the columns have no names and are called 1, 2, ...
    """

    arrays: dict[str, Any]
    is_table: bool = False
    axes: list[Any] | None = None
    sample_rate: float | None = None
    has_names: bool = True


def read(path: Path) -> Content:
    """Read a file in the format that the suffix of its path names.

    Raises
    ------
    RecordError
        If the file is missing, empty, damaged, or of an unknown suffix.
    InputError
        If the format needs a package that is not installed.
    """
    reader = by_suffix(path, _READERS)
    require_content(path)
    return reader(path)


def by_suffix(path: Path, functions: dict[str, Callable[..., Any]]) -> Callable[..., Any]:
    """The function for the suffix of a path; RecordError where there is none."""
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


def extra(module: str, path: Path) -> ModuleType:
    """Import an optional package, or say how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        package = {"nptdms": "npTDMS"}.get(package, package)
        raise InputError(f"{path}: this format needs the package {package}: pip install 'ambid[io]'") from None


def read_csv_columns(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read a table with one header line into its columns, by name; commas, semicolons or tabs separate the cells.

    Raises
    ------
    RecordError
        For a missing header, a duplicated column, a header without rows, or a cell that is not a number (with its row,
        counted from 1).
    """
    content = _read_csv(path)
    require_names(path, content)
    return content.arrays


def require_names(path: Path, content: Content) -> None:
    """Refuse a table without names of its columns."""
    if not content.has_names:
        raise RecordError(f"{path}: the first line holds numbers; put the names of the columns above them")


def _read_csv(path: Path) -> Content:
    try:
        with path.open(encoding="utf-8-sig") as file:
            head = file.readline()
            separator = max(",;\t", key=head.count)
            names = [name.strip() for name in head.split(separator)]
            has_names = not all(_is_number(name) for name in names)
            rows = _rows(file)
            first = next(rows, None) if has_names else head
            if not has_names:
                names = [str(k + 1) for k in range(len(names))]
            twice = [name for name, count in Counter(names).items() if count > 1]
            if twice:
                raise RecordError(f"{path}: column {twice[0]!r} is there {Counter(names)[twice[0]]} times; keep one")
            if first is None:
                raise RecordError(f"{path}: a header without rows; record it again")
            # row by row: the text of a long record is several times as large as its numbers
            table = np.loadtxt(chain([first], rows), delimiter=separator, comments=None, ndmin=2)
    except UnicodeDecodeError:
        raise RecordError(f"{path}: not a text file; give comma-separated text in UTF-8") from None
    except ValueError as error:
        raise RecordError(f"{path}: {_first_bad_cell(path, names, separator, has_names) or error}") from None
    if table.shape[1] != len(names):
        raise RecordError(f"{path}: {len(names)} names in the header, {table.shape[1]} columns below; make them equal")
    return Content(dict(zip(names, table.T, strict=True)), is_table=True, has_names=has_names)


def _rows(file: Iterable[str]) -> Iterator[str]:
    """Lines that hold something."""
    return filter(str.strip, file)


def _first_bad_cell(path: Path, names: list[str], separator: str, has_names: bool) -> str | None:
    """Name the first cell that is no number, or the first row of a wrong length."""
    with path.open(encoding="utf-8-sig") as file:
        if has_names:
            file.readline()
        for row, line in enumerate(_rows(file), start=1):
            cells = line.rstrip("\n").split(separator)
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


def _read_mat(path: Path) -> Content:
    with path.open("rb") as file:
        head = file.read(520)
    # MATLAB puts a block of 512 bytes before the HDF5 signature of a v7.3 file.
    if _HDF5_SIGNATURE in (head[:8], head[512:]):
        return _read_hdf5(path)
    try:
        content = scipy.io.loadmat(path)
    except Exception as error:  # the parser raises whatever a damaged byte leads it to
        raise RecordError(f"{path}: not a readable .mat file ({error}); save it again as v5 or v7.3") from error
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    axes = variables.get("axes")
    arrays = {full: array for name, value in variables.items() for full, array in _members(name, value)}
    return Content(arrays, axes=None if axes is None else _flatten_cells(axes))


def _members(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A variable, or the members of a single structure."""
    members = getattr(getattr(value, "dtype", None), "names", None)
    if members is None or value.size != 1:
        yield name, value
        return
    for member in members:
        yield from _members(f"{name}.{member}", value[member].item())


def _flatten_cells(axes: NDArray[Any]) -> list[Any]:
    """Strings of a MATLAB cell array or char matrix as SciPy returns it."""
    return [cell.item() if isinstance(cell, np.ndarray) and cell.size == 1 else cell for cell in np.ravel(axes)]


def _read_hdf5(path: Path) -> Content:
    h5py = extra("h5py", path)
    is_mat = path.suffix.lower() == ".mat"

    def datasets(group: Any, prefix: str) -> Iterator[tuple[str, Any]]:
        for name, item in group.items():
            if isinstance(item, h5py.Group) and name not in _MATLAB_OWN:
                yield from datasets(item, f"{prefix}{name}{'.' if is_mat else '/'}")
            elif isinstance(item, h5py.Dataset):
                # MATLAB stores column by column: its arrays are turned in HDF5's view.
                turned = "MATLAB_class" in item.attrs or is_mat
                yield f"{prefix}{name}", item[()].T if turned else item[()]

    try:
        with h5py.File(path, "r") as file:
            arrays = dict(datasets(file, ""))
            axes = _hdf5_strings(file, file["axes"]) if "axes" in arrays else None
    except OSError as error:
        raise RecordError(f"{path}: not a readable HDF5 file ({error}); save it again") from error
    return Content(arrays, axes=axes)


def _hdf5_strings(file: Any, dataset: Any) -> list[Any]:
    """Strings of an HDF5 string array, or of a MATLAB v7.3 cell array (references to rows of character codes)."""
    if dataset.dtype.kind == "O" and dataset.attrs.get("MATLAB_class", b"cell") == b"cell":
        cells = np.ravel(dataset[()])
        return ["".join(map(chr, np.ravel(file[cell][()]))) if not isinstance(cell, bytes) else cell for cell in cells]
    if dataset.dtype.kind == "u":
        return ["".join(map(chr, row)) for row in np.atleast_2d(dataset[()].T)]
    return list(np.ravel(dataset[()]))


def _read_parquet(path: Path) -> Content:
    parquet = extra("pyarrow.parquet", path)
    try:
        with path.open("rb") as file:  # pyarrow encodes a path as UTF-8, which not all are
            table = parquet.read_table(file)
    except (OSError, ValueError) as error:
        raise RecordError(f"{path}: not a readable Parquet file ({error}); save it again") from error
    return Content({name: table[name].to_numpy() for name in table.column_names}, is_table=True)


def _read_tdms(path: Path) -> Content:
    nptdms = extra("nptdms", path)
    try:
        groups = nptdms.TdmsFile.read(path).groups()
        channels = [(group.name, channel) for group in groups for channel in group.channels()]
        arrays = {
            f"{group}/{channel.name}" if len(groups) > 1 else channel.name: channel[:] for group, channel in channels
        }
    except Exception as error:  # the parser raises whatever a damaged byte leads it to
        raise RecordError(f"{path}: not a readable TDMS file ({error}); save it again") from error
    steps = {step for _, channel in channels if (step := channel.properties.get("wf_increment", 0.0)) > 0.0}
    return Content(arrays, is_table=True, sample_rate=1.0 / steps.pop() if len(steps) == 1 else None)


_READERS: dict[str, Callable[[Path], Content]] = {
    ".csv": _read_csv,
    ".mat": _read_mat,
    ".h5": _read_hdf5,
    ".hdf5": _read_hdf5,
    ".parquet": _read_parquet,
    ".tdms": _read_tdms,
}
SUFFIXES = tuple(_READERS)
"""Of the formats that a record may have."""
