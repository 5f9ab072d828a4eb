"""Records: every format holds the same data, every gate refuses its one broken thing, ceilings against known noise."""

import time

import numpy as np
import pytest
import scipy.io
from scipy.signal import lfilter

import ambid.record.readers
from ambid.errors import InputError, RecordError
from ambid.excitation import prbs
from ambid.noise import noise_ceiling
from ambid.record import Record, StaticLoading
from ambid.rig import Rig
from places import BENCH as BENCH_FILE
from places import SHARED

h5py = pytest.importorskip("h5py")
pytest.importorskip("pyarrow")

RIG = Rig.load(BENCH_FILE)
AXES = RIG.axes
PERIOD = 127 * 2
CASES = SHARED / "cases"


def measured(periods=5, noise=2e-8, seed=0, cut=0):
    """Keywords of a healthy record: PRBS through a lag, an offset, noise."""
    rng = np.random.default_rng(seed)
    i_e = prbs(7, amplitude=0.2, hold=2, axes=4, periods=periods, seed=seed)
    i_e = i_e[: len(i_e) - cut]
    i_c = 0.3 + lfilter([0, 0.4], [1, -0.6], i_e, axis=0) + rng.normal(0, 1e-3, i_e.shape)
    y = 2e-6 + 5e-6 * lfilter([0, 0.1], [1, -0.9], i_e, axis=0) + rng.normal(0, noise, i_e.shape)
    return {"i_e": i_e, "y": y, "i_c": i_c, "sample_rate": 1e4, "axes": AXES}


def write_csv(path, signals, axes=AXES, t=None, extra=None):
    """A .csv as the contract shows it."""
    samples = len(next(iter(signals.values())))
    columns = {"t": np.arange(samples) / 1e4 if t is None else t} | (extra or {})
    for name, array in signals.items():
        columns |= {f"{name}.{axis}": array[:, j] for j, axis in enumerate(axes)}
    np.savetxt(path, np.stack(list(columns.values()), 1), "%.17g", ",", header=",".join(columns), comments="")
    return path


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


def signals_of(keywords):
    return {name: keywords[name] for name in ("i_e", "y", "i_c") if keywords.get(name) is not None}


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".hdf5", ".parquet"])
def test_every_format_holds_the_same_record(tmp_path, suffix):
    record = Record.from_arrays(**measured(), rig=RIG, name="run")
    record.save(tmp_path / f"run{suffix}")
    again = Record.load(tmp_path / f"run{suffix}", RIG)
    for signal in ("i_e", "y", "i_c", "t"):
        np.testing.assert_array_equal(getattr(again, signal), getattr(record, signal))
    assert (again.name, again.axes, again.sample_rate, again.period) == ("run", AXES, 1e4, PERIOD)
    assert again.notes == ()
    assert again.i_ref is None
    assert Record.load(tmp_path / f"run{suffix}").sample_rate == 1e4


def test_v73_as_matlab_writes_it(tmp_path):
    keywords = measured()
    record = Record.load(write_v73(tmp_path / "run.mat", signals_of(keywords)), RIG)
    np.testing.assert_array_equal(record.y, keywords["y"])
    np.testing.assert_array_equal(record.i_e, keywords["i_e"])
    assert record.axes == AXES
    assert record.notes == ()


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


def test_record_properties_and_repr():
    record = Record.from_arrays(**measured(cut=50), rig=RIG, name="run 7")
    assert (record.samples, record.periods, record.period) == (5 * PERIOD - 50, 4, PERIOD)
    assert record.seconds == pytest.approx(0.122)
    np.testing.assert_allclose(np.diff(record.t), 1e-4)
    for array in (record.y, record.i_e, record.i_c):
        assert array.flags.c_contiguous
        assert not array.flags.writeable
    assert repr(record).startswith(
        "Record('run 7': 1220 samples at 10000 Hz, 0.122 s, 4 periods of 254; i_e y i_c on A_"
    )


def test_inputs_are_not_changed_or_shared():
    keywords = measured()
    y = keywords["y"].copy()
    record = Record.from_arrays(**keywords, rig=RIG)
    keywords["y"][0] = 1.0
    np.testing.assert_array_equal(record.y, y)


def test_axes_are_matched_by_name(tmp_path):
    keywords = measured()
    order = [2, 0, 3, 1]
    mixed = {name: array[:, order] for name, array in signals_of(keywords).items()}
    path = write_csv(tmp_path / "r.csv", mixed, axes=[AXES[j] for j in order])
    record = Record.load(path, RIG)
    np.testing.assert_array_equal(record.y, keywords["y"])
    np.testing.assert_array_equal(record.i_c, keywords["i_c"])
    assert "reordered" in record.notes[0]
    assert Record.load(path).axes == tuple(AXES[j] for j in order)


def test_i_e_is_rebuilt_on_loading_with_the_rig(tmp_path):
    keywords = measured()
    path = write_csv(tmp_path / "r.csv", {"y": keywords["y"] - keywords["y"].mean(axis=0), "i_c": keywords["i_c"]})
    assert Record.load(path).i_e is None
    assert "load the record with its rig" in Record.load(path).notes[-1]
    record = Record.load(path, RIG)
    assert record.i_e.shape == record.y.shape
    assert "rebuilt from i_c" in " ".join(record.notes)


def change(signal, where, value):
    def broken(keywords):
        keywords[signal] = keywords[signal].copy()
        keywords[signal][where] = value
        return keywords

    return broken


def scaled(signal, factor):
    return lambda keywords: keywords | {signal: keywords[signal] * factor}


def clipped(signal, level):
    def broken(keywords):
        x = keywords[signal] - keywords[signal].mean(axis=0)
        x[:, 2] = np.clip(x[:, 2], -level, level * np.ptp(x[:, 2]) / 2)
        return keywords | {signal: x}

    return broken


BROKEN = {
    "NaN in y": (change("y", (700, 1), np.nan), ["y.A_eta", "nan", "row 701"]),
    "infinite current": (change("i_c", (3, 0), -np.inf), ["i_c.A_zeta", "inf", "row 4"]),
    "NaN in i_e": (change("i_e", (0, 3), np.nan), ["i_e.B_eta", "row 1 "]),
    "dead displacement sensor": (change("y", (slice(None), 2), 1e-6), ["y.B_zeta", "constant", "1e-06"]),
    "dead current sensor": (change("i_c", (slice(None), 3), 0.0), ["i_c.B_eta", "constant"]),
    "clipped displacement": (clipped("y", 0.6), ["y.B_zeta", "clipped", "%"]),
    "no excitation": (scaled("i_e", 0.0), ["no excitation", "i_e"]),
    "constant excitation": (change("i_e", slice(None), 0.5), ["no excitation", "0.5"]),
    "y in micrometres": (scaled("y", 1e6), ["y.A_zeta", "0.0005", "micrometres"]),
    "i_c in mA": (scaled("i_c", 1e3), ["i_c.A_zeta", "mA", "rms"]),
    "i_e in mA": (scaled("i_e", 1e3), ["i_e.A_zeta", "mA"]),
    "too short": (lambda k: k | {s: k[s][:150] for s in ("i_e", "y", "i_c")}, ["150 samples", "200"]),
    "lengths differ": (lambda k: k | {"i_c": k["i_c"][:-1]}, ["i_c", "(1269, 4)", "(1270, 4)"]),
    "a column too few": (lambda k: k | {"y": k["y"][:, :3]}, ["shape", "(1270, 3)", "(1270, 4)"]),
    "one-dimensional": (lambda k: k | {"y": k["y"][:, 0]}, ["shape", "(1270,)"]),
    "text": (lambda k: k | {"y": [["a", "b", "c", "d"]] * 300}, ["y is not an array of real numbers"]),
    "unknown axis": (lambda k: k | {"axes": (*AXES[:3], "C_eta")}, ["missing: B_eta", "unknown: C_eta"]),
    "axis twice": (lambda k: k | {"axes": (*AXES[:3], "A_zeta")}, ["named twice"]),
    "another rate": (lambda k: k | {"sample_rate": 2e4}, ["20000 Hz", "10000 Hz", "rig"]),
    "rate off by 0.2 %": (lambda k: k | {"sample_rate": 10020.0}, ["10020", "0.1 %"]),
    "negative rate": (lambda k: k | {"sample_rate": -1e4}, ["-10000"]),
    "period too long": (lambda k: k | {"period": 5000}, ["period = 5000", "1270"]),
    "period of a half": (lambda k: k | {"period": 0.5}, ["period = 0.5"]),
    "nothing to rebuild from": (lambda k: k | {"i_e": None, "i_c": None}, ["i_e is missing", "i_ref and i_c"]),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_arrays(name):
    broken, words = BROKEN[name]
    with pytest.raises(RecordError) as caught:
        Record.from_arrays(**broken(measured()), rig=RIG, name="run")
    for word in ("run: ", *words):
        assert word in str(caught.value)


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


times = np.arange(5 * PERIOD) / 1e4
BROKEN_CSV = {
    "empty file": (lambda path: path.write_text(""), ["empty"]),
    "missing file": (lambda path: None, ["no such file"]),
    "not a text": (lambda path: path.write_bytes(b"\xff\xfe\x00" * 99), ["not a text file"]),
    "header only": (rewritten(lambda lines: lines[:1]), ["without rows"]),
    "no header": (rewritten(lambda lines: lines[1:]), ["first line holds numbers"]),
    "word in a cell": (cell(57, 6, "off"), ["row 57", "y.A_eta", "'off'"]),
    "empty cell": (cell(8, 1, ""), ["row 8", "i_e.A_zeta", "''"]),
    "decimal comma": (cell(9, 1, "0,2"), ["row 9", "14 cells", "13"]),
    "cut row": (rewritten(lambda lines: [*lines[:-1], lines[-1][:40]]), ["row 1270", "cells"]),
    "NaN cell": (cell(12, 5, "nan"), ["y.A_zeta", "row 12"]),
    "NaN in t": (cell(12, 0, "nan"), ["t is nan", "row 12"]),
    "no t": (without("t"), ["column 't'", "missing"]),
    "one y missing": (without("y.B_zeta"), ["missing: none", "unknown: B_zeta", "i_e"]),
    "one i_c missing": (without("i_c.A_eta"), ["i_c", "missing: A_eta"]),
    "no y": (rewritten(lambda lines: [lines[0].replace("y.", "x."), *lines[1:]]), ["y.<axis>"]),
    "column twice": (rewritten(lambda lines: [lines[0].replace("y.A_eta", "y.A_zeta"), *lines[1:]]), ["2 times"]),
    "t in milliseconds": (with_times(times * 1e3), ["10 Hz", "milliseconds"]),
    "t in samples": (with_times(np.arange(5 * PERIOD)), ["sample numbers"]),
    "another rate": (with_times(times / 2), ["20000 Hz", "rig"]),
    "t goes back": (with_times(np.where(times == times[90], 0.0, times)), ["not increase", "row 91"]),
    "t stands": (with_times(np.where(times == times[90], times[89], times)), ["not increase", "more digits"]),
    "gap in t": (with_times(times + 3e-4 * (times > times[499])), ["gap", "row 501", "3 samples"]),
    "lost sample": (rewritten(lambda lines: lines[:300] + lines[301:]), ["gap", "row 300", "1 samples"]),
}


@pytest.mark.parametrize("name", BROKEN_CSV)
def test_broken_csv(tmp_path, name):
    write, words = BROKEN_CSV[name]
    path = tmp_path / "bad.csv"
    write(path)
    with pytest.raises(RecordError) as caught:
        Record.load(path, RIG)
    for word in (str(path), *words):
        assert word in str(caught.value)


MATRICES = {"fs": 1e4, "t": times, "axes": np.array(AXES, dtype=object)}
BROKEN_MAT = {
    "no y": ({"y": None}, ["variable 'y'"]),
    "neither fs nor t": ({"fs": None, "t": None}, ["neither 'fs' [Hz] nor 't'"]),
    "fs against t": ({"fs": 5e3}, ["t says 10000 Hz, fs says 5000 Hz"]),
    "two rates": ({"fs": [1e4, 2e4]}, ["fs has 2 values"]),
    "t of another length": ({"t": times[:-1]}, ["t has 1269 rows, y has 1270"]),
    "complex y": ({"y": measured()["y"] * 1j}, ["y holds complex128"]),
    "axes as numbers": ({"axes": [1, 2, 3, 4]}, ["'axes' is not a list of names"]),
    "three axes": ({"axes": np.array(AXES[:3], dtype=object)}, ["'axes' names 3"]),
    "three dimensions": ({"y": np.ones((300, 2, 2))}, ["(300, 2, 2)"]),
}


@pytest.mark.parametrize("name", BROKEN_MAT)
def test_broken_mat(tmp_path, name):
    changes, words = BROKEN_MAT[name]
    content = MATRICES | signals_of(measured()) | changes
    path = tmp_path / "bad.mat"
    scipy.io.savemat(path, {key: value for key, value in content.items() if value is not None})
    with pytest.raises(RecordError) as caught:
        Record.load(path, RIG)
    for word in (str(path), *words):
        assert word in str(caught.value)


@pytest.mark.parametrize("suffix", [".mat", ".h5", ".parquet"])
def test_damaged_and_unknown_files(tmp_path, suffix):
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(np.random.default_rng(0).bytes(2000))
    with pytest.raises(RecordError, match="not a readable"):
        Record.load(path)
    with pytest.raises(RecordError, match=r"suffix '.xlsx'.*\.parquet"):
        Record.load(tmp_path / "run.xlsx")
    with pytest.raises(RecordError, match="suffix"):
        Record.from_arrays(**measured(), rig=RIG).save(tmp_path / "run.txt")


@pytest.mark.parametrize("suffix", [".h5", ".parquet"])
def test_missing_package_says_how_to_install(tmp_path, monkeypatch, suffix):
    def missing(name):
        raise ImportError(name)

    (tmp_path / f"r{suffix}").write_bytes(b"x")
    monkeypatch.setattr(ambid.record.readers.importlib, "import_module", missing)
    with pytest.raises(InputError, match=r"pip install 'ambid\[io\]'"):
        Record.load(tmp_path / f"r{suffix}")


def test_stated_notes(tmp_path):
    keywords = measured()
    signals = signals_of(keywords)

    def notes(record):
        return " | ".join(record.notes)

    assert "not used: speed" in notes(Record.load(write_csv(tmp_path / "a.csv", signals, extra={"speed": times}), RIG))
    assert "starts at 3 s" in notes(Record.load(write_csv(tmp_path / "b.csv", signals, t=times + 3), RIG))
    jitter = times + np.random.default_rng(0).uniform(-1e-5, 1e-5, times.size)
    assert "jitters" in notes(Record.load(write_csv(tmp_path / "c.csv", signals, t=jitter), RIG))
    slow = write_csv(tmp_path / "d.csv", signals, t=times * 1.0005)
    assert "taken as the rig's 10000 Hz" in notes(Record.load(slow, RIG))
    assert Record.load(slow, RIG).sample_rate == 1e4
    turned = {name: array.T for name, array in signals.items()}
    scipy.io.savemat(tmp_path / "e.mat", MATRICES | turned)
    assert "y is stored as axes x N" in notes(Record.load(tmp_path / "e.mat", RIG))
    scipy.io.savemat(tmp_path / "f.mat", {"fs": 1e4} | signals)
    assert "names no axes" in notes(Record.load(tmp_path / "f.mat", RIG))
    with pytest.raises(RecordError, match="names no axes"):
        Record.load(tmp_path / "f.mat")

    assert "cannot be told apart" in notes(Record.from_arrays(**keywords | {"i_c": None}, rig=RIG))
    still = change("i_e", (slice(None), 1), 0.0)(measured())
    assert "i_e.A_eta is constant" in notes(Record.from_arrays(**still, rig=RIG))
    limited = clipped("i_c", 0.6)(measured())
    assert "i_c.B_zeta is clipped" in notes(Record.from_arrays(**limited, rig=RIG))
    assert "2 whole periods" in notes(Record.from_arrays(**measured(periods=2), rig=RIG))
    assert "no period" in notes(Record.from_arrays(**measured(periods=1), rig=RIG))
    assert "repeats after 254" in notes(Record.from_arrays(**keywords, rig=RIG, period=300))
    assert Record.from_arrays(**keywords, rig=RIG, period=2 * PERIOD).notes[0].startswith("2 whole periods")


@pytest.mark.parametrize("seed", range(5))
def test_coarse_converters_are_not_clipped(seed):
    """Signals of few levels also stand at their extremes; that is resolution, not clipping."""
    keywords = measured(seed=seed)
    rng = np.random.default_rng(seed)
    step = np.ptp(keywords["y"]) / rng.uniform(6, 40)
    quantised = keywords | {"y": np.round(keywords["y"] / step) * step}
    assert Record.from_arrays(**quantised, rig=RIG).notes == ()
    sine = 1e-5 * np.sin(np.arange(5 * PERIOD) / rng.uniform(20, 50, 1))
    sine = np.round(sine / 8e-7) * 8e-7
    Record.from_arrays(**keywords | {"y": np.tile(sine[:, None], 4)}, rig=RIG)


@pytest.mark.parametrize("seed", range(12))
def test_noise_ceiling_is_that_of_the_known_noise(seed):
    """Against the fit of the noise-free response itself; the scatter of both over 9 periods is below 0.3 % of fit."""
    noise = 10 ** np.random.default_rng(seed).uniform(-8, -6.3)
    clean = Record.from_arrays(**measured(periods=10, noise=0.0, seed=seed), rig=RIG)
    noisy = Record.from_arrays(**measured(periods=10, noise=noise, seed=seed), rig=RIG)
    ceiling = noise_ceiling(noisy)
    assert set(ceiling) == {f"{signal}.{axis}" for signal in ("y", "i_c") for axis in AXES}
    for j, axis in enumerate(AXES):
        y, exact = noisy.y[PERIOD:, j], clean.y[PERIOD:, j]
        misfit = np.linalg.norm((y - y.mean()) - (exact - exact.mean())) / np.linalg.norm(y - y.mean())
        # Relative standard error of a scatter with 8 * 254 degrees of freedom: 1 / sqrt(2 * 2032) = 1.6 %.
        assert 100 - ceiling[f"y.{axis}"] == pytest.approx(100 * misfit, rel=0.07)


def test_noise_ceiling_is_unbiased():
    """The mean over many records and axes leaves no room for a missing M / (M - 1), which is 22 % at M = 3."""
    ratios = []
    for seed in range(20):
        record = Record.from_arrays(**measured(periods=4, noise=3e-7, seed=seed), rig=RIG)
        for j, axis in enumerate(AXES):
            y = record.y[PERIOD:, j]
            ratios.append((1 - noise_ceiling(record)[f"y.{axis}"] / 100) * y.std() / 3e-7)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.01)


def test_noise_ceiling_needs_two_periods_after_the_transient():
    assert np.isnan(noise_ceiling(Record.from_arrays(**measured(periods=2), rig=RIG))["y.A_zeta"])
    assert noise_ceiling(Record.from_arrays(**measured(periods=3), rig=RIG))["y.A_zeta"] > 50


def test_large_csv_is_read_fast(tmp_path):
    rng = np.random.default_rng(0)
    signals = {name: rng.normal(0, 1e-6, (20000, 4)) for name in ("i_e", "y", "i_c")}
    path = write_csv(tmp_path / "large.csv", signals)
    start = time.process_time()
    Record.load(path)
    assert time.process_time() - start < 0.6  # 0.15 s alone on one core


LOADS = """step,z,F_x,F_y,i_c.A_zeta,i_c.A_eta,i_c.B_zeta,i_c.B_eta
0,0.43,0,0,0.01,0.02,0.01,0
1,0.43,250,0,-0.4,0.4,-0.3,0.3
2,0.43,500,1,-0.8,0.8,-0.6,0.6
3,0.43,0,250,-0.4,-0.4,-0.3,-0.3
"""


def test_static_loading(tmp_path):
    path = tmp_path / "static_1.csv"
    path.write_text(LOADS)
    loads = StaticLoading.load(path, RIG)
    assert (loads.name, loads.axes, loads.i_c.shape, loads.notes) == ("static_1", AXES, (4, 4), ())
    np.testing.assert_array_equal(loads.force[2], [500, 1])
    assert "4 steps up to 500 N" in repr(loads)
    path.write_text(LOADS.replace("i_c.A_zeta,i_c.A_eta", "i_c.A_eta,i_c.A_zeta"))
    swapped = StaticLoading.load(path, RIG)
    np.testing.assert_array_equal(swapped.i_c[:, [1, 0, 2, 3]], loads.i_c)
    assert "reordered" in swapped.notes[0]
    assert StaticLoading.load(path).axes[0] == "A_eta"


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("F_x", "Fx", "no column F_x"),
        ("i_c.", "i.", "i_c.<axis>"),
        ("i_c.B_eta", "i_c.C_eta", "unknown: C_eta"),
        ("500", "nan", "F_x is nan in row 3"),
        ("0.43", "430", "off the shaft"),
        ("-0.8", "-800", "mA"),
        ("0.02", "a", "'a' is not a number"),
        ("1,0.43,250,0,-0.4,0.4,-0.3,0.3\n2,0.43,500,1,-0.8,0.8,-0.6,0.6\n", "", "2 load steps"),
        (LOADS, "", "empty"),
    ],
)
def test_broken_static_loading(tmp_path, old, new, word):
    path = tmp_path / "static_1.csv"
    path.write_text(LOADS.replace(old, new))
    with pytest.raises(RecordError) as caught:
        StaticLoading.load(path, RIG)
    assert word in str(caught.value)
    assert str(path) in str(caught.value)


def test_static_loading_needs_a_change_of_load(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("step,z,F_x,F_y,i_c.A_zeta\n0,0.4,9,9,0.1\n1,0.4,9,9,0.2\n2,0.4,9,9,0.3\n")
    with pytest.raises(RecordError, match="two different loads"):
        StaticLoading.load(path)
    with pytest.raises(RecordError, match="use .csv"):
        StaticLoading.load(tmp_path / "s.mat")


@pytest.mark.skipif(not CASES.is_dir(), reason="the measured cases are not beside the project")
def test_measured_cases():
    """Periods are 2047 x 2, 1023 x 5 and 511 x 10; the ceilings are those of the cases' own table."""
    expected = {"01": (4094, 95.4), "02": (4094, 95.4), "04": (5110, 99.9), "07": (5115, 99.9)}
    for folder in sorted(CASES.glob("0*")):
        period, ceiling = expected.get(folder.name[:2], (5115, 99.4))
        rig = Rig.load(folder / "rig.toml")
        for path in [*folder.glob("*.csv"), *folder.glob("*.mat")]:
            record = Record.load(path, rig)
            assert (record.period, record.notes) == (period, ())
            fits = [fit for channel, fit in noise_ceiling(record).items() if channel.startswith("y.")]
            if path.stem != "validate":
                assert np.mean(fits) == pytest.approx(ceiling, abs=0.1)
