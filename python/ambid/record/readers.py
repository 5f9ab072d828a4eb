"""The file formats of records, CSV, MATLAB (v5 and v7.3), HDF5, Parquet and TDMS, read into named arrays."""

import importlib
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from fractions import Fraction
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ambid.errors import InputError, RecordError
from ambid.findings import Finding, Kind
from ambid.reading import MOST_COLUMNS, load_mat, reading, require_size, variables_of, watched
from ambid.record.content import Content, NotNumbers, Stored, Timing, require_columns, require_names
from ambid.record.csv_table import read_table

NPTDMS = Kind("tdms_reader", "warning", "npTDMS: {text}")
"""What the package for TDMS says of a file, such as that it was cut."""

EXTERNAL_LINK = Kind("external_link", "warning", "{name}: leads to another file, and is not followed")

T = TypeVar("T")

DEEPEST = 32
"""Groups within each other; files of loggers have three."""
MOST_AXES = 64
"""Names in ``axes``; a machine has some ten, and each is looked up by itself."""


@contextmanager
def opened(path: Path) -> Iterator[Content]:
    """What a file holds, in the format that the suffix of its path names; large arrays are read when asked for.

    Raises
    ------
    RecordError
        If the file is missing, empty, damaged, or of an unknown suffix; also where that shows within.
    InputError
        If the format needs a package that is not installed.
    """
    reader = by_suffix(path, _READERS)
    require_content(path)
    suffix = path.suffix.lower()
    what = f"a readable {_CALLED.get(suffix, suffix)} file"
    with (
        reading(path, RecordError, what, "save it again"),
        watched(path, RecordError) as provenance,
        reader(path) as content,
    ):
        require_columns(path, len(content.arrays))
        content.provenance = provenance
        yield content


def by_suffix(path: Path, functions: dict[str, T]) -> T:
    """The function for the suffix of a path; RecordError where there is none."""
    suffix = path.suffix.lower()
    _require_no_folder(path)
    if suffix not in functions:
        allowed = ", ".join(functions)
        raise RecordError(f"{path}: suffix {suffix!r} is not a record format; use one of {allowed}")
    return functions[suffix]


def _require_no_folder(path: Path) -> None:
    if path.is_dir():
        raise RecordError(f"{path}: is a folder, and a record is a file; name one that lies in it")


def require_content(path: Path) -> None:
    """Raise RecordError unless the path is a file with something in it."""
    _require_no_folder(path)
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


def read_csv_columns(path: Path) -> dict[str, NDArray[np.float64] | NotNumbers]:
    """Read a table with one header line into its columns, by name; commas, semicolons or tabs separate the cells.

    Raises
    ------
    RecordError
        For a missing header, a duplicated column, or a header without rows.
    """
    with opened(path) as content:
        require_names(path, content.has_names)
        return content.arrays


@contextmanager
def _read_csv(path: Path) -> Iterator[Content]:
    yield read_table(path)


@contextmanager
def _read_mat(path: Path) -> Iterator[Content]:
    with path.open("rb") as file:
        head = file.read(520)
    # MATLAB puts a block of 512 bytes before the HDF5 signature of a v7.3 file.
    if b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:]):
        with _read_hdf5(path) as content:
            yield content
        return
    known = variables_of(path) or []
    later = {v.name: Stored(v.shape, v.dtype, partial(_variable, path, v.name)) for v in known if v.dtype is not None}
    now = load_mat(path, [v.name for v in known if v.dtype is None] if known else None)
    found = {v.name: later.get(v.name, now.get(v.name)) for v in known} or now
    axes = found.get("axes")
    arrays = {full: array for name, value in found.items() for full, array in _members(name, value)}
    yield Content(arrays, axes=None if axes is None else flatten_cells(np.asarray(axes)))


def _variable(path: Path, name: str) -> NDArray[Any]:
    return np.asarray(load_mat(path, [name])[name])


def _members(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A variable, or the members of a structure, or of each of several, counted from 1."""
    members = getattr(getattr(value, "dtype", None), "names", None)
    if members is None:
        yield name, value
        return
    for k, own in enumerate(value.ravel(), start=1):
        at = name if value.size == 1 else f"{name}[{k}]"
        for member in members:
            yield from _members(f"{at}.{member}", own[member])


def flatten_cells(axes: NDArray[Any]) -> list[Any]:
    """Strings of a MATLAB cell array or char matrix as SciPy returns it."""
    return [cell.item() if isinstance(cell, np.ndarray) and cell.size == 1 else cell for cell in np.ravel(axes)]


@contextmanager
def _read_hdf5(path: Path) -> Iterator[Content]:
    """Only what is asked for is read, and no link is left; of MATLAB v7.3 too."""
    h5py = extra("h5py", path)
    is_mat = path.suffix.lower() == ".mat"
    with h5py.File(path, "r", locking=False) as file:
        content = Content({})
        for name, dataset in _datasets(path, h5py, file, "." if is_mat else "/", content.findings):
            # MATLAB stores column by column: its arrays are turned in HDF5's view.
            content.arrays[name] = _stored(path, name, dataset, "MATLAB_class" in dataset.attrs or is_mat)
        if "axes" in content.arrays:
            content.axes = _names(path, file, file["axes"])
        yield content


def _datasets(path: Path, h5py: Any, file: Any, joint: str, findings: list[Finding]) -> Iterator[tuple[str, Any]]:
    """All sets of a file, each group entered once: hard links may lead back to a group that holds them.

    An array of MATLAB structures is a group of sets of references, a set a member: they are followed, counted from 1.
    """
    seen, found, waiting = {file["/"]}, 0, [("", file["/"], 0)]
    while waiting:
        place, group, depth = waiting.pop()
        inner = []
        for name in group:
            full = f"{place}{joint}{name}" if place else name
            is_external = isinstance(group.get(name, getlink=True), h5py.ExternalLink)
            item: Any = None if is_external else group.get(name)
            is_array = isinstance(item, h5py.Dataset) and _is_of_structures(h5py, group, item)
            found += item.size or 0 if is_array else 1
            if found > MOST_COLUMNS:
                raise RecordError(f"{path}: more than {MOST_COLUMNS} groups and sets; save those of the record alone")
            if is_external:
                findings.append(EXTERNAL_LINK(name=full))
            own = {full: item}
            if is_array:
                references = np.ravel(_stored(path, full, item, is_turned=True).values)
                own = {f"{place}[{k}]{joint}{name}": file[one] for k, one in enumerate(references, start=1)}
            for at, one in own.items():
                if isinstance(one, h5py.Dataset):
                    yield at, one
                elif isinstance(one, h5py.Group) and name not in ("#refs#", "#subsystem#") and one not in seen:
                    if depth == DEEPEST:
                        raise RecordError(f"{path}: groups nested deeper than {DEEPEST}; save the record flat")
                    seen.add(one)
                    inner.append((at, one, depth + 1))
        waiting += reversed(inner)


def _is_of_structures(h5py: Any, group: Any, dataset: Any) -> bool:
    """Whether a set holds a member of every structure of an array; a cell array states its own class."""
    is_member = group.attrs.get("MATLAB_class") == b"struct" and "MATLAB_class" not in dataset.attrs
    return is_member and h5py.check_ref_dtype(dataset.dtype) is h5py.Reference


def _stored(path: Path, name: str, dataset: Any, is_turned: bool) -> Stored:
    # MATLAB stores the codes of letters, and the shape of what is empty.
    is_text = dataset.attrs.get("MATLAB_class") == b"char"
    shape = (0, 0) if dataset.attrs.get("MATLAB_empty") else dataset.shape or ()

    def read() -> NDArray[Any]:
        if dataset.is_virtual or dataset.external:
            raise RecordError(f"{path}: {name} holds its values in other files, which are not read; save them in one")
        require_size(path, name, shape, dataset.dtype.itemsize, dataset.id.get_storage_size())
        values = dataset[()]
        return values.T if is_turned else values

    return Stored(shape[::-1] if is_turned else shape, np.dtype(str) if is_text else dataset.dtype, read)


def _names(path: Path, file: Any, dataset: Any) -> list[Any]:
    """Strings of an HDF5 string array, or of a MATLAB v7.3 cell array (references to rows of character codes)."""
    if dataset.dtype.kind == "u":
        return ["".join(map(chr, row)) for row in np.atleast_2d(_letters(path, dataset).T)]
    if dataset.size is None or dataset.size > MOST_AXES:
        raise RecordError(f"{path}: 'axes' has the shape {dataset.shape}; give the names of at most {MOST_AXES} axes")
    cells = list(np.ravel(dataset[()]))
    if dataset.dtype.kind == "O" and dataset.attrs.get("MATLAB_class", b"cell") == b"cell":
        return [c if isinstance(c, bytes) else "".join(map(chr, np.ravel(_letters(path, file[c])))) for c in cells]
    return cells


def _letters(path: Path, dataset: Any) -> NDArray[Any]:
    if dataset.dtype.kind != "u" or not 0 < dataset.size <= MOST_AXES * 200:  # letters in a name of ``axes``
        raise RecordError(
            f"{path}: 'axes' leads to {dataset.dtype} of shape {dataset.shape}; give each axis as a line of letters"
        )
    return np.asarray(dataset[()])


@contextmanager
def _read_parquet(path: Path) -> Iterator[Content]:
    parquet = extra("pyarrow.parquet", path)
    # It takes no path that is not UTF-8. Threads that read the stream now and then abort a process that ends, likely as
    # they let go of it when Python has ended; a column at a time does not need them.
    with path.open("rb") as stream, parquet.ParquetFile(stream, pre_buffer=False) as file:
        rows, names = file.metadata.num_rows, file.schema_arrow.names
        # A constant column takes some bytes whatever its length: only the memory is a bound.
        require_size(path, "a column", (rows,), 8)

        def stored(name: str, kind: Any) -> Stored:
            return Stored((rows,), _numpy_type(kind), lambda: file.read([name], use_threads=False)[name].to_numpy())

        yield Content(
            {name: stored(name, kind) for name, kind in zip(names, file.schema_arrow.types, strict=True)}, is_table=True
        )


def _numpy_type(kind: Any) -> np.dtype[Any]:
    """That a column of a Parquet file is read as; object where it holds no numbers."""
    try:
        return np.dtype(kind.to_pandas_dtype())
    except (RuntimeError, TypeError):  # no type of pandas, and none of NumPy
        return np.dtype(object)


@contextmanager
def _read_tdms(path: Path) -> Iterator[Content]:
    nptdms = extra("nptdms", path)
    stored, heard = path.stat().st_size, _Heard()
    with _heard_by(heard), nptdms.TdmsFile.open(path, raw_timestamps=True) as file:
        found = [(group.name, channel) for group in file.groups() for channel in group.channels()]
        is_grouped = len({group for group, _ in found}) > 1
        channels = {f"{group}/{own.name}" if is_grouped else own.name: own for group, own in found}
        places: dict[str, list[str]] = {}
        for group, own in found:
            places.setdefault(own.name, []).append(f"{group}/{own.name}")
        aliases = {name: several[0] for name, several in places.items() if len(several) == 1}
        if not is_grouped:
            aliases = {full: name for name, full in aliases.items()}

        def values(name: str, channel: Any) -> Stored:
            def read() -> NDArray[Any]:
                require_size(path, name, (len(channel),), channel.dtype.itemsize, stored)
                return np.asarray(channel[:])

            return Stored((len(channel),), channel.dtype, read)

        yield Content(
            {name: values(name, channel) for name, channel in channels.items()},
            is_table=True,
            aliases=aliases,
            shared={name: several for name, several in places.items() if len(several) > 1},
            timing=timing_of({name: channel.properties for name, channel in channels.items()}),
            findings=heard.findings,
        )


class _Heard(logging.Handler):
    """What npTDMS says of a file, such as that it was cut, once each."""

    findings: list[Finding]

    def __init__(self) -> None:
        super().__init__()
        self.findings = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it."""
        if (found := NPTDMS(text=record.getMessage())) not in self.findings:
            self.findings.append(found)


@contextmanager
def _heard_by(handler: _Heard) -> Iterator[None]:
    """Take what npTDMS says from the terminal, where nobody would know which file it is about."""
    loggers = [logging.getLogger(name) for name in list(logging.root.manager.loggerDict) if name.startswith("nptdms.")]
    before = [logger.handlers for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [handler], False
    try:
        yield
    finally:
        for logger, handlers in zip(loggers, before, strict=True):
            logger.handlers, logger.propagate = handlers, True


_READERS: dict[str, Callable[[Path], AbstractContextManager[Content]]] = {
    ".csv": _read_csv,
    ".mat": _read_mat,
    ".h5": _read_hdf5,
    ".hdf5": _read_hdf5,
    ".parquet": _read_parquet,
    ".tdms": _read_tdms,
}
_CALLED = {".h5": "HDF5", ".hdf5": "HDF5", ".parquet": "Parquet", ".tdms": "TDMS"}
SUFFIXES = tuple(_READERS)
"""Of the formats that a record may have."""


def timing_of(properties: Mapping[str, Mapping[str, Any]]) -> dict[str, Timing]:
    """Timing of the channels of a file, by name, with the earliest start as the origin.

    Parameters
    ----------
    properties : mapping of str to mapping
        Of each channel; ``wf_increment`` [s], ``wf_start_time`` as it is stored, and ``wf_start_offset`` [s] from there
        to the first sample (NI, "TDMS File Format Internal Structure"; NI, waveform properties).
    """
    stamps = {name: _stamp(own) for name, own in properties.items()}
    if not any(stamps.values()) and any("wf_start_offset" in own for own in properties.values()):
        stamps = dict.fromkeys(properties, Fraction(0))  # offsets from an instant that all share
    starts = {
        name: None if (stamp := stamps[name]) is None else stamp + Fraction(_number(own.get("wf_start_offset")) or 0.0)
        for name, own in properties.items()
    }
    origin = min((start for start in starts.values() if start is not None), default=Fraction(0))
    return {
        name: Timing(_increment(own), None if (start := starts[name]) is None else float(start - origin))
        for name, own in properties.items()
    }


def _stamp(own: Mapping[str, Any]) -> Fraction | None:
    """Start time [s]; None where it is not stated, as a time of 0 is what nobody has set."""
    stamp = own.get("wf_start_time")
    if not (seconds := getattr(stamp, "seconds", 0)):
        return None
    # parts of a second that a time stamp counts
    return Fraction(seconds) + Fraction(getattr(stamp, "second_fractions", 0), 1 << 64)


def _increment(own: Mapping[str, Any]) -> float | None:
    """Sample time that a channel states [s]; None where ``wf_increment`` is no step in time."""
    step = _number(own.get("wf_increment"))
    return step if step is not None and step > 0.0 and 1.0 / step < np.inf else None


def _number(value: Any) -> float | None:
    """A finite number, or None."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
    return float(value) if is_number else None
