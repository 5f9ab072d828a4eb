"""Signals and frequency responses written to file formats that `ambid.record` reads, with the names they have there."""

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
import scipy.io

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.record.raw import APART
from ambid.record.raw_response import COVARIANCE
from ambid.record.readers import by_suffix, extra
from ambid.writing import whole_file

Signals = Mapping[str, FloatArray]
Writer = Callable[[BinaryIO, float, Sequence[str], Signals], None]


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
        By name, such as ``y``, all of one length; a channel by itself, such as ``b.A_zeta``, has one column.

    Raises
    ------
    RecordError
        If the suffix is unknown.
    InputError
        If the format needs a package that is not installed, or as `ambid.writing.whole_file`.
    OutputError
        If the file cannot be written; what was there stands.
    """
    require_format(path)
    with whole_file(path) as stream:
        by_suffix(path, _WRITERS)(stream, sample_rate, axes, signals)


def require_format(path: Path) -> None:
    """Refuse a file whose format is unknown, or needs a package that is not installed, before any work is done.

    Raises
    ------
    RecordError
        If the suffix is unknown.
    InputError
        If a package is missing.
    """
    by_suffix(path, _WRITERS)
    for module in _NEEDED.get(path.suffix.lower(), ()):
        extra(module, path)


def _time(sample_rate: float, signals: Signals) -> FloatArray:
    return np.arange(len(next(iter(signals.values())))) / sample_rate


def _columns(sample_rate: float, axes: Sequence[str], signals: Signals) -> dict[str, FloatArray]:
    columns = {"t": _time(sample_rate, signals)}
    for signal, array in signals.items():
        if "." in signal:  # a channel by itself
            columns[signal] = array[:, 0]
        else:
            columns |= {f"{signal}.{axis}": array[:, j] for j, axis in enumerate(axes)}
    return columns


def _write_csv(stream: BinaryIO, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    columns = _columns(sample_rate, axes, signals)
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(stream, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="", encoding="utf-8")


def _write_mat(stream: BinaryIO, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    names = np.array(axes, dtype=object).reshape(-1, 1)
    own = {name: array for name, array in signals.items() if "." not in name}
    apart: dict[str, dict[str, FloatArray]] = {}
    for name in (name for name in signals if name not in own):  # a name of MATLAB has no dots
        signal, _, place = name.partition(".")
        apart.setdefault(signal, {})[place] = signals[name]
    content = {"fs": sample_rate, "t": _time(sample_rate, signals).reshape(-1, 1), **own, "axes": names}
    content |= {APART: apart} if apart else {}
    scipy.io.savemat(stream, content, do_compression=True)


def _write_hdf5(stream: BinaryIO, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    import h5py

    whole = BytesIO()  # HDF5 leaves a file open, and the process in danger, when the disk under it is full
    with h5py.File(whole, "w") as file:
        for name, value in {"fs": sample_rate, "t": _time(sample_rate, signals), **signals}.items():
            file[f"{APART}.{name}" if "." in name else name] = value
        file["axes"] = list(axes)
    stream.write(whole.getbuffer())


def _write_parquet(stream: BinaryIO, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(_columns(sample_rate, axes, signals)), stream)


def _write_tdms(stream: BinaryIO, sample_rate: float, axes: Sequence[str], signals: Signals) -> None:
    import nptdms

    step = {"wf_increment": 1.0 / sample_rate}
    columns = _columns(sample_rate, axes, signals)
    channels = [nptdms.ChannelObject("record", name, column, step) for name, column in columns.items()]
    with nptdms.TdmsWriter(stream) as writer:
        writer.write_segment(channels)


_WRITERS: dict[str, Writer] = {
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".parquet": _write_parquet,
    ".tdms": _write_tdms,
}
_NEEDED = {".h5": ("h5py",), ".hdf5": ("h5py",), ".parquet": ("pyarrow", "pyarrow.parquet"), ".tdms": ("nptdms",)}
"""Packages beyond those that ambid always has, by suffix."""


def require_response_format(path: Path) -> None:
    """Refuse a suffix that is not written."""
    if path.suffix.lower() not in (".csv", ".mat"):
        raise RecordError(
            f"{path}: suffix {path.suffix!r} is not one that frequency responses are written with; use one of "
            ".csv, .mat"
        )


def write_response(
    path: Path,
    frequency_hz: FloatArray,
    response: ComplexArray,
    std: FloatArray,
    outputs: Sequence[str],
    inputs: Sequence[str],
    covariance: ComplexArray | None,
    spread: float,
) -> None:
    """Write the attributes of a `FrequencyResponse`; pairs that were not measured have no row in a table.

    Raises
    ------
    RecordError
        If the suffix is unknown.
    OutputError
        If the file cannot be written; what was there stands.
    """
    require_response_format(path)
    with whole_file(path) as stream:
        if path.suffix.lower() == ".mat":
            content = {"frequency_hz": frequency_hz.reshape(-1, 1), "response": response, "std": std}
            for name, own in (("outputs", outputs), ("inputs", inputs)):
                content[name] = np.array(own, dtype=object).reshape(-1, 1)
            if covariance is not None:
                content |= {"covariance": covariance, "spread": np.array(spread)}
            scipy.io.savemat(stream, content, do_compression=True)
            return
        pairs = [f"{output} / {inlet}" for output in outputs for inlet in inputs]
        of_pairs = [f",{part} {pair}" for pair in pairs for part in COVARIANCE] if covariance is not None else []
        lines = ["frequency_hz,output,input,re,im,std" + "".join(of_pairs) + ",spread" * bool(of_pairs)]
        for k, o, i in np.argwhere(np.isfinite(response)):
            h = response[k, o, i]
            numbers = f"{h.real:.17g},{h.imag:.17g},{std[k, o, i]:.9g}"
            if covariance is not None:  # Hermitian: the other half of it needs no words
                row = len(inputs) * o + i
                numbers += "".join(f",{c.real:.12g},{c.imag:.12g}" for c in covariance[k, row, : row + 1])
                numbers += ",," * (len(pairs) - row - 1) + f",{spread:.9g}"
            lines.append(f"{frequency_hz[k]:.17g},{outputs[o]},{inputs[i]},{numbers}")
        stream.write("\n".join([*lines, ""]).encode())
