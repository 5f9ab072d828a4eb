"""Records whose files are whole, but hold what no logger writes: odd types, shapes, sizes, links, and nests."""

import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.io
import scipy.sparse

import ambid
from fuzz.mutations import Rng, pick

KEYS = ("fs", "t", "i_e", "y", "i_c", "i_ref", "axes", "scope", "x" * 40)


def odd(rng: Rng, good: np.ndarray) -> Any:
    """Something in place of an array of numbers."""
    n = len(good) if good.ndim else 1
    return pick(
        rng,
        (
            lambda: good.astype(np.float32),
            lambda: good.astype(complex),
            lambda: (good * 1e6).astype(np.int8),
            lambda: good > 0,
            lambda: good.T,
            lambda: good[: int(rng.integers(n + 1))],
            lambda: np.zeros((0, 1)),
            lambda: np.array(1.0),
            lambda: np.ones((n, 2, 2)),
            lambda: np.ones((2, n)),
            lambda: np.full(good.shape, pick(rng, (np.nan, np.inf, 1e300, 0.0, 5e-324))),
            lambda: good * pick(rng, (1e-300, 1e150, 1e300, -1.0, 1e6)),
            lambda: np.array(["a", "\x1b[31m"]),
            lambda: np.array([["A_zeta"]], dtype=object),
            lambda: "A_zeta",
            lambda: np.array([1, "x", None], dtype=object),
        ),
    )()


def contents(record: ambid.Record, rng: Rng) -> dict[str, Any]:
    """The arrays of a record, one or two of them odd, missing, or of another name."""
    held: dict[str, Any] = {
        "fs": np.array(record.sample_rate),
        "t": record.t,
        "i_e": record.i_e,
        "y": record.y,
        "i_c": record.i_c,
        "axes": np.array(record.axes, dtype=object),
    }
    for _ in range(int(rng.integers(1, 3))):
        key = pick(rng, KEYS)
        if rng.random() < 0.15:
            held.pop(key, None)
        elif key != "axes" or rng.random() < 0.5:
            held[key] = odd(rng, np.asarray(held[key]) if key in held and key != "axes" else record.y)
    return held


def mat(rng: Rng, path: Path, record: ambid.Record) -> None:
    """A .mat file of version 5 or 4."""
    held = contents(record, rng)
    if rng.random() < 0.5:
        key, value = pick(rng, ("y", "scope", "axes", "i_e")), record.y
        held[key] = pick(
            rng,
            (
                lambda: {"y": value, "t": record.t, "inner": {"y": value}},
                lambda: scipy.sparse.csc_array(value),
                lambda: np.array([[value, "x"]], dtype=object),
                lambda: np.zeros((2, 2), dtype=[("a", object), ("b", object)]),
                lambda: np.array(["ab", "cd"]),
            ),
        )()
    is_old = rng.random() < 0.2
    if is_old:
        held = {k: v for k, v in held.items() if isinstance(v, np.ndarray) and v.dtype.kind in "fiuc" and v.ndim <= 2}
    scipy.io.savemat(path, held, format="4" if is_old else "5", do_compression=bool(rng.integers(2)), oned_as="column")
    if not is_old and rng.random() < 0.3:
        with path.open("ab") as file:
            file.write(pick(rng, (lambda: nested(int(10 ** rng.uniform(1, 4.5))), bomb, dimensions))())


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def array(kind: int, shape: tuple[int, ...], rest: bytes, name: bytes = b"y") -> bytes:
    flags, sizes = element(6, struct.pack("<II", kind, 0)), element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(14, flags + sizes + element(1, name) + rest)


def nested(depth: int) -> bytes:
    """Cells within cells."""
    heads, inner = [], len(array(6, (1, 1), element(9, struct.pack("<d", 1.0)), b""))
    flags, sizes = element(6, struct.pack("<II", 1, 0)), element(5, struct.pack("<ii", 1, 1))
    head = flags + sizes + element(1, b"")
    for _ in range(depth):
        heads.append(struct.pack("<II", 14, inner + len(head)) + head)
        inner += len(head) + 8
    return b"".join(reversed(heads)) + array(6, (1, 1), element(9, struct.pack("<d", 1.0)), b"")


def bomb() -> bytes:
    """A variable of 2 MB that expands to 2 GB; only its first and last bytes are not the same."""
    packer, zeros, count = zlib.compressobj(9), bytes(1 << 24), 128
    head = array(6, (1 << 14, 1 << 14), b"")[8:]
    data = struct.pack("<II", 14, len(head) + 8 + count * len(zeros)) + head + struct.pack("<II", 9, count * len(zeros))
    first = packer.compress(data) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(zeros) + packer.flush(zlib.Z_FULL_FLUSH)
    packed = first + block * count + packer.flush()
    return struct.pack("<II", 15, len(packed)) + packed


def dimensions() -> bytes:
    """A cell array that declares four thousand million cells."""
    return array(1, (1 << 16, 1 << 16), b"")


def hdf5(rng: Rng, path: Path, record: ambid.Record) -> None:
    """An HDF5 file; odd links, sets that hold nothing, filters, groups within each other."""
    with h5py.File(path, "w") as file:
        for key, value in contents(record, rng).items():
            if isinstance(value, np.ndarray) and value.dtype.kind in "UO":
                value = [str(entry) for entry in value.ravel()]
            file[key] = value
        for _ in range(int(rng.integers(3))):
            _odd_hdf5(rng, file, path, record)


def _odd_hdf5(rng: Rng, file: h5py.File, path: Path, record: ambid.Record) -> None:
    name = pick(rng, ("y", "i_c", "axes", "unused", "t", "g/y", "\x1b[31m"))
    if name in file:
        del file[name]
    big = pick(rng, ((1 << 40,), (1 << 20, 1 << 20), (1 << 28,)))
    how = int(rng.integers(14))
    if how < 3:
        _odd_link(rng, file, name, path, how)
    elif how == 3:
        file.create_dataset(name, big, dtype="f8", chunks=True)
    elif how == 4:
        file.create_dataset(name, (1 << 26,), dtype="f8", compression="gzip", chunks=(1 << 20,))[: 1 << 21] = 1.0
    elif how == 5:
        file[name] = np.zeros(5, dtype=[("a", "f8"), ("b", "S5"), ("c", "f8", (2, 2))])
    elif how == 6:
        file.create_dataset(name, (3,), dtype=h5py.ref_dtype)[0] = file.ref
    elif how == 7:
        group = file
        for _ in range(int(10 ** rng.uniform(0, 3))):
            group = group.create_group(name.replace("/", "_"))
        group["y"] = record.y
    elif how == 8:
        layout = h5py.VirtualLayout((100, 1), dtype="f8")
        layout[:] = h5py.VirtualSource("/etc/passwd", "y", (100, 1))
        file.create_virtual_dataset(name, layout)
    elif how == 9:
        file.create_dataset(name, (100,), dtype="f8", external=[("/etc/passwd", 0, 800)])
    elif how == 10:
        file[name] = h5py.Empty("f8")
    elif how == 11:
        file[name] = np.array(["a", "b"], dtype=h5py.string_dtype())
    elif how == 12:
        for k in range(int(10 ** rng.uniform(1, 4.1))):
            file[f"many/{k}"] = 0.0
    else:
        file[name] = record.y
        file[name].attrs["MATLAB_class"] = pick(rng, ("double", b"cell", 5, np.zeros(3)))


def _odd_link(rng: Rng, file: h5py.File, name: str, path: Path, how: int) -> None:
    if how == 0:
        group = file.create_group(name)
        group["back"] = file["/"]
    elif how == 1:
        file[name] = h5py.ExternalLink(pick(rng, ("/etc/passwd", str(path), "none.h5")), "/y")
    else:
        file[name] = h5py.SoftLink(pick(rng, ("/nowhere", "/", f"/{name}")))


def parquet(rng: Rng, path: Path, record: ambid.Record) -> None:
    """A Parquet file with columns of odd types, or of a constant that is stored once."""
    n = record.samples
    columns: dict[str, Any] = {
        "t": pa.array(record.t),
        "i_e.A_zeta": pa.array(record.i_e[:, 0]),
        "y.A_zeta": pa.array(record.y[:, 0]),
        "i_c.A_zeta": pa.array(record.i_c[:, 0]),
    }
    y = record.y[:, 0]
    for _ in range(int(rng.integers(1, 3))):
        columns[pick(rng, (*columns, "y.B_zeta", "x", "\x1b[31m"))] = pick(
            rng,
            (
                lambda: pa.array([[1.0, 2.0]] * n),
                lambda: pa.array(["x"] * n),
                lambda: pa.array([None] * n),
                lambda: pa.array([None, *y[1:]]),
                lambda: pa.array(y).dictionary_encode(),
                lambda: pa.array((y * 1e9).astype("i8"), pa.timestamp("us")),
                lambda: pa.array((y * 1e3).astype("i4")).cast(pa.decimal128(20, 2)),
                lambda: pa.array([{"a": 1.0}] * n),
                lambda: pa.array([b"x"] * n),
                lambda: pa.array(y.astype("f2")),
                lambda: pa.array(y > 0),
                lambda: pa.array(y * 1e300),
            ),
        )()
    table = pa.table(columns)
    if rng.random() < 0.2:
        table = pa.table({name: pa.array(np.zeros(1 << 22)) for name in columns})
    elif rng.random() < 0.1:
        table = pa.Table.from_arrays(list(columns.values()), names=["t", *["y.A_zeta"] * (len(columns) - 1)])
    pyarrow.parquet.write_table(table, path)


def tdms(rng: Rng, path: Path, record: ambid.Record) -> None:
    """A TDMS file with odd properties and channels."""
    steps = (0.0, -1.0, np.inf, np.nan, 1e-320, "fast", 1e-4, True, np.datetime64("2020-01-01"), 2**40, 1e300)
    channels = []
    for name, values in (("i_e.A_zeta", record.i_e), ("y.A_zeta", record.y), ("i_c.A_zeta", record.i_c)):
        data = values[:, 0]
        if rng.random() < 0.3:
            data = pick(
                rng,
                (
                    lambda d=data: d.astype("f4"),
                    lambda d=data: (d * 1e6).astype("i2"),
                    lambda d=data: d[:100],
                    lambda d=data: d.astype(complex),
                    lambda: ["x"] * record.samples,
                    lambda: np.arange(record.samples).astype("datetime64[s]"),
                    lambda d=data: d * 1e300,
                    lambda: np.zeros(0),
                ),
            )()
        group = pick(rng, ("g", "g", "g", "h\x1b[31m"))
        channels.append(nptdms.ChannelObject(group, name, data, {"wf_increment": pick(rng, steps)}))
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(channels)


WRITERS = {".mat": mat, ".h5": hdf5, ".parquet": parquet, ".tdms": tdms}
