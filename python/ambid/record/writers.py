"""Signals written to the file formats that `ambid.record.readers` reads, with the names that a record has there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.io

from ambid.arrays import FloatArray
from ambid.record.readers import by_suffix, extra

__all__ = ["write"]

Signals = Mapping[str, FloatArray]
Writer = Callable[[Path, float, Sequence[str], Signals], None]


def write(path: Path, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    """Write signals in the format that the suffix of the path names.

    Parameters
    ----------
    path : Path
    sample_rate : float
        [Hz].
    axes : sequence of str
        Names of the columns.
    signals : mapping of str to ndarray, shape (N, axes)
        By name, such as ``y``, all of one length.

    Raises
    ------
    RecordError
        If the suffix is unknown.
    InputError
        If the format needs a package that is not installed.
    """
    by_suffix(path, _WRITERS)(path, sample_rate, axes, signals)


def _time(sample_rate: float, signals: Signals) -> FloatArray:
    return np.arange(len(next(iter(signals.values())))) / sample_rate


def _columns(sample_rate: float, axes: Sequence[str], signals: Signals) -> dict[str, FloatArray]:
    columns = {"t": _time(sample_rate, signals)}
    for signal, array in signals.items():
        columns |= {f"{signal}.{axis}": array[:, j] for j, axis in enumerate(axes)}
    return columns


def _write_csv(path: Path, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    columns = _columns(sample_rate, axes, signals)
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


def _write_mat(path: Path, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    names = np.array(axes, dtype=object).reshape(-1, 1)
    content = {"fs": sample_rate, "t": _time(sample_rate, signals).reshape(-1, 1), **signals, "axes": names}
    scipy.io.savemat(path, content, do_compression=True)


def _write_hdf5(path: Path, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    h5py = extra("h5py", path)
    with h5py.File(path, "w") as file:
        for name, value in {"fs": sample_rate, "t": _time(sample_rate, signals), **signals}.items():
            file[name] = value
        file["axes"] = list(axes)


def _write_parquet(path: Path, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    parquet = extra("pyarrow.parquet", path)
    parquet.write_table(extra("pyarrow", path).table(_columns(sample_rate, axes, signals)), path)


def _write_tdms(path: Path, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    nptdms = extra("nptdms", path)
    step = {"wf_increment": 1.0 / sample_rate}
    columns = _columns(sample_rate, axes, signals)
    channels = [nptdms.ChannelObject("record", name, column, step) for name, column in columns.items()]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)


_WRITERS: dict[str, Writer] = {
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".parquet": _write_parquet,
    ".tdms": _write_tdms,
}
