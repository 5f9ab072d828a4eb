"""Records written to the file formats that `ambid.readers` reads, with the names that `ambid.raw_record` expects."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.io
from numpy.typing import NDArray

from ambid.raw_record import SIGNALS
from ambid.readers import by_suffix, extra

if TYPE_CHECKING:
    from ambid.record import Record


def write(record: Record, path: Path) -> None:
    """Write a record in the format that the suffix of the path names.

    Raises
    ------
    RecordError
        If the suffix is unknown.
    InputError
        If the format needs a package that is not installed.
    """
    by_suffix(path, _WRITERS)(record, path)


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
    h5py = extra("h5py", path)
    with h5py.File(path, "w") as file:
        for name, value in {"fs": record.sample_rate, "t": record.t, **_signals(record)}.items():
            file[name] = value
        file["axes"] = list(record.axes)


def _write_parquet(record: Record, path: Path) -> None:
    parquet = extra("pyarrow.parquet", path)
    parquet.write_table(extra("pyarrow", path).table(_columns(record)), path)


def _write_tdms(record: Record, path: Path) -> None:
    nptdms = extra("nptdms", path)
    step = {"wf_increment": 1.0 / record.sample_rate}
    channels = [nptdms.ChannelObject("record", name, column, step) for name, column in _columns(record).items()]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)


_WRITERS: dict[str, Callable[[Record, Path], None]] = {
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".parquet": _write_parquet,
    ".tdms": _write_tdms,
}
