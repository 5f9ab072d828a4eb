"""Files of records: every format holds the same data, and every broken file is refused in its own words."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import ambid.record.readers
from ambid.errors import InputError, RecordError
from ambid.record import Record
from ambid.record.readers import opened
from found import codes
from reference.records import AXES, MATRICES, PERIOD, RIG, measured, signals_of, times, write_csv

h5py = pytest.importorskip("h5py")
pytest.importorskip("pyarrow")


def write_v73(path, signals, axes=AXES):
    """A .mat of version 7.3 as MATLAB writes it: a user block, arrays column by column, a cell array of references."""
    samples = len(signals["y"])
    with h5py.File(path, "w", userblock_size=512) as file:
        arrays = {"fs": np.array([[1e4]]), "t": np.arange(samples)[None, :] / 1e4}
        for name, array in (arrays | {name: array.T for name, array in signals.items()}).items():
            file[name] = array
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        cells = file.create_dataset("axes", (1, len(axes)), dtype=h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        for j, axis in enumerate(axes):
            codes = file.create_dataset(f"#refs#/{j}", data=np.array([[ord(c)] for c in axis], dtype=np.uint16))
            codes.attrs["MATLAB_class"] = np.bytes_("char")
            cells[0, j] = codes.ref
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    return path


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".hdf5", ".parquet"])
def test_every_format_holds_the_same_record(tmp_path, suffix):
    record = Record.from_arrays(**measured(), rig=RIG, name="run")
    record.save(tmp_path / f"run{suffix}")
    again = Record.load(tmp_path / f"run{suffix}", RIG)
    for signal in ("i_e", "y", "i_c", "t"):
        np.testing.assert_array_equal(getattr(again, signal), getattr(record, signal))
    assert (again.name, again.axes, again.sample_rate, again.period) == ("run", AXES, 1e4, PERIOD)
    assert again.findings == ()
    assert again.i_ref is None
    assert Record.load(tmp_path / f"run{suffix}").sample_rate == 1e4


TASKS = """
import os, sys, pyarrow.parquet
from ambid import Record
count = lambda: len(os.listdir("/proc/self/task"))
before = count()
Record.load(sys.argv[1])
print(count() - before)
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted where Linux lists them")
def test_parquet_is_read_without_threads(tmp_path):
    """One that lets go of the file while Python ends would end the process with an abort."""
    Record.from_arrays(**measured(), rig=RIG).save(tmp_path / "run.parquet")
    command = [sys.executable, "-c", TASKS, tmp_path / "run.parquet"]
    assert int(subprocess.run(command, capture_output=True, text=True, check=True).stdout) == 0


def test_v73_as_matlab_writes_it(tmp_path):
    keywords = measured()
    record = Record.load(write_v73(tmp_path / "run.mat", signals_of(keywords)), RIG)
    np.testing.assert_array_equal(record.y, keywords["y"])
    np.testing.assert_array_equal(record.i_e, keywords["i_e"])
    assert record.axes == AXES
    assert record.findings == ()


@pytest.mark.parametrize("axes", [np.array(AXES), np.array(AXES, dtype=object), np.array([AXES], dtype=object)])
def test_v5_axes_as_char_matrix_or_cells(tmp_path, axes):
    scipy.io.savemat(tmp_path / "a.mat", {"fs": 1e4, **signals_of(measured()), "axes": axes})
    assert Record.load(tmp_path / "a.mat", RIG).axes == AXES


def test_hdf5_with_named_columns(tmp_path):
    keywords = measured()
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["t"] = np.arange(len(keywords["y"])) / 1e4
        for name, array in signals_of(keywords).items():
            for j, axis in enumerate(AXES):
                file[f"{name}.{axis}"] = array[:, j]
    np.testing.assert_array_equal(Record.load(tmp_path / "run.h5", RIG).y, keywords["y"])


def rewritten(edit):
    """The text of a healthy .csv, edited line by line."""

    def write(path):
        write_csv(path, signals_of(measured()))
        lines = path.read_text().splitlines()
        path.write_text("\n".join(edit(lines)) + "\n")

    return write


def cell(row, column, value):
    def edit(lines):
        cells = lines[row].split(",")
        cells[column] = value
        return [*lines[:row], ",".join(cells), *lines[row + 1 :]]

    return rewritten(edit)


def with_times(t):
    return lambda path: write_csv(path, signals_of(measured()), t=t)


def without(column):
    def edit(lines):
        index = lines[0].split(",").index(column)
        return [",".join(c for j, c in enumerate(line.split(",")) if j != index) for line in lines]

    return rewritten(edit)


BROKEN_CSV = {
    "empty file": (lambda path: path.write_text(""), []),
    "missing file": (lambda path: None, []),
    "not a text": (lambda path: path.write_bytes(b"\xff\xfe\x00" * 99), []),
    "header only": (rewritten(lambda lines: lines[:1]), []),
    "no header": (rewritten(lambda lines: lines[1:]), []),
    "word in a cell": (cell(57, 6, "off"), ["row 57", "y.A_eta", "'off'"]),
    "empty cell": (cell(8, 1, ""), ["row 8", "i_e.A_zeta", "''"]),
    "decimal comma": (cell(9, 1, "0,2"), ["row 9", "14", "13"]),
    "cut row": (rewritten(lambda lines: [*lines[:-1], lines[-1][:40]]), ["row 1270"]),
    "NaN cell": (cell(12, 5, "nan"), ["y.A_zeta", "row 12"]),
    "NaN in t": (cell(12, 0, "nan"), ["nan", "row 12"]),
    "no t": (without("t"), ["'t'"]),
    "one y missing": (without("y.B_zeta"), ["y.B_zeta"]),
    "one i_c missing": (without("i_c.A_eta"), ["i_c", "A_eta"]),
    "no y": (rewritten(lambda lines: [lines[0].replace("y.", "x."), *lines[1:]]), ["y.<axis>"]),
    "column twice": (rewritten(lambda lines: [lines[0].replace("y.A_eta", "y.A_zeta"), *lines[1:]]), ["y.A_zeta"]),
    "t in milliseconds": (with_times(times * 1e3), ["10 Hz", "milliseconds"]),
    "t in samples": (with_times(np.arange(5 * PERIOD)), []),
    "another rate": (with_times(times / 2), ["20000 Hz"]),
    "t goes back": (with_times(np.where(times == times[90], 0.0, times)), ["row 91"]),
    "t stands": (with_times(np.where(times == times[90], times[89], times)), ["row 91"]),
    "gap in t": (with_times(times + 3e-4 * (times > times[499])), ["row 501", " 3 "]),
    "lost sample": (rewritten(lambda lines: lines[:300] + lines[301:]), ["row 300", " 1 "]),
}


@pytest.mark.parametrize("name", BROKEN_CSV)
def test_broken_csv(tmp_path, name, golden):
    write, values = BROKEN_CSV[name]
    path = tmp_path / "bad.csv"
    write(path)
    with golden.raises(RecordError) as caught:
        Record.load(path, RIG)
    for value in (str(path), *values):
        assert value in str(caught.value)


BROKEN_MAT = {
    "no y": {"y": None},
    "neither fs nor t": {"fs": None, "t": None},
    "fs against t": {"fs": 5e3},
    "two rates": {"fs": [1e4, 2e4]},
    "t of another length": {"t": times[:-1]},
    "complex y": {"y": measured()["y"] * 1j},
    "axes as numbers": {"axes": [1, 2, 3, 4]},
    "three axes": {"axes": np.array(AXES[:3], dtype=object)},
    "three dimensions": {"y": np.ones((300, 2, 2))},
}


@pytest.mark.parametrize("name", BROKEN_MAT)
def test_broken_mat(tmp_path, name, golden):
    content = MATRICES | signals_of(measured()) | BROKEN_MAT[name]
    path = tmp_path / "bad.mat"
    scipy.io.savemat(path, {key: value for key, value in content.items() if value is not None})
    with golden.raises(RecordError):
        Record.load(path, RIG)


@pytest.mark.parametrize("suffix", [".mat", ".h5", ".parquet"])
def test_damaged_and_unknown_files(tmp_path, suffix, golden):
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(np.random.default_rng(0).bytes(2000))
    with pytest.raises(RecordError) as damaged:
        Record.load(path)
    assert str(path) in str(damaged.value)  # the rest is another package's
    with golden.raises(RecordError):
        Record.load(tmp_path / "run.xlsx")
    with golden.raises(RecordError):
        Record.from_arrays(**measured(), rig=RIG).save(tmp_path / "run.txt")


@pytest.mark.parametrize("suffix", [".h5", ".parquet"])
def test_missing_package_says_how_to_install(tmp_path, monkeypatch, suffix, golden):
    def missing(name):
        raise ImportError(name)

    (tmp_path / f"r{suffix}").write_bytes(b"x")
    monkeypatch.setattr(ambid.record.readers.importlib, "import_module", missing)
    with golden.raises(InputError):
        Record.load(tmp_path / f"r{suffix}")


def test_a_csv_is_parsed_row_by_row_and_not_cell_by_cell(tmp_path):
    """Python runs a few functions a row, whatever the count of columns."""
    rng, rows = np.random.default_rng(0), 2000
    signals = {name: rng.normal(0, 1e-6, (rows, 4)) for name in ("i_e", "y", "i_c")}
    path = write_csv(tmp_path / "large.csv", signals)
    calls = 0

    def count(frame, event, argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        Record.load(path)
    finally:
        sys.setprofile(None)
    assert calls < 13 * rows


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".parquet", ".tdms"])
def test_what_was_read_is_told_by_its_hash(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    Record.from_arrays(**measured(), rig=RIG, name="run").save(path)
    content = path.read_bytes()
    found = Record.load(path)
    path.unlink()
    assert (found.provenance.sha256, found.provenance.size) == (hashlib.sha256(content).hexdigest(), len(content))


def test_a_file_that_is_written_while_it_is_read_is_refused(tmp_path, golden):
    path = tmp_path / "run.mat"
    Record.from_arrays(**measured(), rig=RIG, name="run").save(path)
    with golden.raises(RecordError), opened(path):
        path.write_bytes(path.read_bytes() + b"more")


def edited(tmp_path, edit):
    """A healthy .csv, edited line by line."""
    path = tmp_path / "edited.csv"
    rewritten(edit)(path)
    return path


def quoted(line):
    return ",".join(f'"{cell}"' for cell in line.split(","))


@pytest.mark.parametrize(
    ("edit", "code"),
    [
        (lambda lines: [quoted(lines[0]), *lines[1:]], None),
        (lambda lines: [quoted(line) for line in lines], None),
        (lambda lines: [f"{line}," for line in lines], "empty_last_column"),
        (lambda lines: [lines[0], *(f"{line}," for line in lines[1:])], "empty_last_column"),
        (lambda lines: [f"{lines[0]},", *lines[1:]], None),
        (lambda lines: [line.replace(",", " ") for line in lines], "separated_by_white_space"),
        (lambda lines: [line.replace(",", "   ") for line in lines], "separated_by_white_space"),
        (lambda lines: [f"{line};".replace(",", ";") for line in lines], "empty_last_column"),
    ],
    ids=["names in quotes", "all in quotes", "ends", "rows end", "header ends", "spaces", "many spaces", "semicolons"],
)
def test_csv_as_other_programs_write_it(tmp_path, edit, code):
    plain = Record.load(edited(tmp_path, lambda lines: lines), RIG)
    found = Record.load(edited(tmp_path, edit), RIG)
    np.testing.assert_array_equal(found.y, plain.y)
    np.testing.assert_array_equal(found.i_e, plain.i_e)
    assert codes(found) == ([code] if code else [])


@pytest.mark.parametrize(
    "edit",
    [
        lambda lines: [lines[0], *(line.replace(".", ",") for line in lines[1:])],
        lambda lines: [lines[0], *(f"{line},7" for line in lines[1:])],
        lambda lines: [f"{line},7" if k else f"{line}," for k, line in enumerate(lines)],
        lambda lines: [f"{line}," if k != 5 else f"{line},7" for k, line in enumerate(lines)],
        lambda lines: [line.replace("y.A_eta", "", 1) for line in lines[:1]] + ["x," * 12 + "1"],
    ],
    ids=["decimal commas", "a cell too many", "a last column without a name", "one cell", "text"],
)
def test_csv_that_is_wrong_says_what(tmp_path, edit, golden):
    with golden.raises(RecordError):
        Record.load(edited(tmp_path, edit), RIG)


def test_y_that_other_signals_have_more_of_is_missing_without_a_rig_too(tmp_path, golden):
    path = tmp_path / "run.csv"
    without("y.A_eta")(path)
    with golden.raises(RecordError):
        Record.load(path)
