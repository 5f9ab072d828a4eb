"""Records that were not made for us: columns by name and number, factors, sample rates, and what is refused."""

import numpy as np
import pytest
import scipy.io

import ambid.record.readers
from ambid.errors import InputError, RecordError
from ambid.excitation import prbs
from ambid.model import Model
from ambid.record import ChannelMap, Record
from ambid.rig import Rig
from found import codes, the
from places import BENCH as BENCH_FILE

RIG = Rig.load(BENCH_FILE)
COLUMNS = [f"{signal}.{axis}" for signal in ("i_e", "y", "i_c") for axis in RIG.axes]
MAP = {"t": "time:1e-3"} | {c: f"ch{k}:{1e-6 if c[0] == 'y' else 1e-3:g}" for k, c in enumerate(COLUMNS)}


@pytest.fixture(scope="module")
def record():
    return Model(RIG).virtual_experiment(prbs(6, amplitude=0.1, hold=2, axes=4, periods=4), seed=1)


@pytest.fixture(scope="module")
def foreign(record):
    """Time in ms, currents in mA, displacements in um, under names of somebody else."""
    signals = np.hstack([record.i_e * 1e3, record.y * 1e6, record.i_c * 1e3])
    return {"time": record.t * 1e3} | {f"ch{k}": column for k, column in enumerate(signals.T)}


def write_csv(path, columns, separator=",", head=True):
    table = np.stack(list(columns.values()), axis=1)
    header = separator.join(columns) if head else ""
    np.savetxt(path, table, "%.17g", separator, header=header, comments="")
    return path


def write(path, columns, record):
    if path.suffix == ".csv":
        write_csv(path, columns)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {name: column[:, None] for name, column in columns.items()} | {"comment": "bench 3"})
    elif path.suffix == ".h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            for name, column in columns.items():
                file[name] = column
    elif path.suffix == ".parquet":
        pyarrow = pytest.importorskip("pyarrow")
        parquet = pytest.importorskip("pyarrow.parquet")
        parquet.write_table(pyarrow.table(columns | {"comment": ["bench 3"] * record.samples}), path)
    else:
        nptdms = pytest.importorskip("nptdms")
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment([nptdms.ChannelObject("scope", name, column) for name, column in columns.items()])
    return path


def assert_same(found, record):
    for signal in ("i_e", "y", "i_c"):
        ours, theirs = getattr(found, signal), getattr(record, signal)
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12 * np.abs(theirs).max())
    assert found.sample_rate == record.sample_rate
    assert found.axes == record.axes


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".parquet", ".tdms"])
def test_every_format_by_names(tmp_path, foreign, record, suffix):
    path = write(tmp_path / f"scope{suffix}", foreign | {"speed": record.t}, record)
    found = Record.load(path, RIG, mapping=MAP)
    assert_same(found, record)
    mapped = the(found, "columns_mapped").values
    assert (mapped["channels"][:2], mapped["columns"][:2]) == (["t", "i_e.A_zeta"], ["time", "ch0"])
    assert (mapped["count"], mapped["factors"][:2]) == (len(MAP), [1e-3, 1e-3])
    assert "speed" in the(found, "columns_not_used").values["names"]
    options = [f"{channel}={column}" for channel, column in MAP.items()]
    assert_same(Record.load(path, RIG, mapping=ChannelMap.parse(options)), record)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_text_without_names_by_numbers(tmp_path, foreign, record, separator):
    path = write_csv(tmp_path / "scope.csv", foreign, separator, head=False)
    by_number = {channel: f"{k}:{column.partition(':')[2]}" for k, (channel, column) in enumerate(MAP.items(), 1)}
    assert_same(Record.load(path, RIG, mapping=by_number), record)
    named = write_csv(tmp_path / "named.csv", foreign, separator)
    assert_same(Record.load(named, RIG, mapping=by_number), record)


@pytest.mark.parametrize("turned", [False, True])
def test_columns_of_a_matrix_in_a_structure(tmp_path, foreign, record, turned):
    table = np.stack(list(foreign.values()), axis=1)
    scope = {"result": table.T if turned else table, "Fs": 1e4}
    scipy.io.savemat(tmp_path / "scope.mat", {"scope": scope})
    channels = {"fs": "scope.Fs"} | {
        channel: f"scope.result[{k}]:{column.partition(':')[2]}"
        for k, (channel, column) in enumerate(MAP.items(), 1)
        if channel != "t"
    }
    found = Record.load(tmp_path / "scope.mat", RIG, mapping=channels)
    assert_same(found, record)
    assert ("matrix_transposed" in codes(found)) == turned


def test_groups_of_hdf5(tmp_path, foreign, record):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "scope.h5", "w") as file:
        for name, column in foreign.items():
            file[f"run/{name}"] = column
    channels = {channel: f"run/{column}" for channel, column in MAP.items()}
    assert_same(Record.load(tmp_path / "scope.h5", RIG, mapping=channels), record)


def test_structure_of_v73(tmp_path, foreign, record):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "scope.mat", "w", userblock_size=512) as file:
        for name, column in foreign.items():
            file[f"run/{name}"] = column[None, :]
        file["#refs#/0"] = np.zeros(3)
    with open(tmp_path / "scope.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    channels = {channel: f"run.{column}" for channel, column in MAP.items()}
    found = Record.load(tmp_path / "scope.mat", RIG, mapping=channels)
    assert_same(found, record)
    assert "columns_not_used" not in codes(found)


def test_groups_and_sample_rate_of_tdms(tmp_path, foreign, record, golden):
    nptdms = pytest.importorskip("nptdms")
    channels = [
        nptdms.ChannelObject("slow" if name == "time" else "scope", name, column, {"wf_increment": 1e-4})
        for name, column in foreign.items()
    ]
    with nptdms.TdmsWriter(tmp_path / "scope.tdms") as writer:
        writer.write_segment(channels)
    mapping = {channel: f"scope/{column}" for channel, column in MAP.items() if channel != "t"}
    assert_same(Record.load(tmp_path / "scope.tdms", RIG, mapping=mapping), record)
    with golden.raises(RecordError):
        Record.load(tmp_path / "scope.tdms", mapping=mapping, sample_rate=5e3)


def test_our_own_tdms(tmp_path, record, golden):
    pytest.importorskip("nptdms")
    record.save(tmp_path / "run.tdms")
    found = Record.load(tmp_path / "run.tdms", RIG)
    assert_same(found, record)
    assert found.findings == ()
    (tmp_path / "bad.tdms").write_bytes(np.random.default_rng(0).bytes(2000))
    with golden.raises(RecordError):
        Record.load(tmp_path / "bad.tdms")


def test_tdms_needs_a_package(tmp_path, monkeypatch, golden):
    def missing(name):
        raise ImportError(name)

    (tmp_path / "run.tdms").write_bytes(b"x")
    monkeypatch.setattr(ambid.record.readers.importlib, "import_module", missing)
    with golden.raises(InputError):
        Record.load(tmp_path / "run.tdms")


def test_sample_rate_of_a_file_that_states_none(tmp_path, foreign, record, golden):
    path = write_csv(tmp_path / "scope.csv", foreign)
    without_time = {channel: column for channel, column in MAP.items() if channel != "t"}
    assert_same(Record.load(path, RIG, mapping=without_time, sample_rate=1e4), record)
    with golden.raises(RecordError):
        Record.load(path, RIG, mapping=without_time)
    with golden.raises(RecordError):
        Record.load(path, mapping=MAP, sample_rate=5e3)
    ours = write_csv(tmp_path / "ours.csv", {f"y.{axis}": record.y[:, k] for k, axis in enumerate(RIG.axes)})
    assert Record.load(ours, sample_rate=1e4).sample_rate == 1e4
    with golden.raises(RecordError):
        Record.load(ours)


def test_without_i_e_it_is_rebuilt(tmp_path, foreign, record):
    path = write_csv(tmp_path / "scope.csv", foreign)
    mapping = {channel: column for channel, column in MAP.items() if not channel.startswith("i_e")}
    found = Record.load(path, RIG, mapping=mapping)
    assert found.excitation_source == "rebuilt_from_current"


def test_names_with_colons(tmp_path, foreign, record, golden):
    path = write_csv(tmp_path / "scope.csv", {name.replace("ch", "Dev1: ai:"): c for name, c in foreign.items()})
    mapping = {channel: column.replace("ch", "Dev1: ai:") for channel, column in MAP.items()}
    assert_same(Record.load(path, RIG, mapping=mapping), record)
    golden.holds(repr(ChannelMap(mapping)))
    golden.holds(repr(ChannelMap({"y.A_zeta": "ai:volts"})))


REFUSED = (
    ["y.A_zeta"],
    ["=ch3"],
    ["y.A_zeta=a", "y.A_zeta=b"],
    ["x.A_zeta=a"],
    ["y=a"],
    ["y.A_zeta=a:0"],
    ["y.A_zeta=a:nan"],
    ["t=a"],
    [],
)


@pytest.mark.parametrize("options", REFUSED, ids=" ".join)
def test_maps_that_are_refused(options, golden):
    with golden.raises(InputError):
        ChannelMap.parse(options)


@pytest.mark.parametrize(
    ("channel", "column"),
    [("y.A_zeta", "ch99"), ("y.A_zeta", "0"), ("fs", "ch3"), ("y.C_zeta", "ch1"), ("y.A_zeta", "ch4:1")],
)
def test_files_that_do_not_fit_the_map(tmp_path, foreign, channel, column, golden):
    path = write_csv(tmp_path / "scope.csv", foreign)
    with golden.raises(RecordError):
        Record.load(path, RIG, mapping=MAP | {channel: column})


def test_columns_of_different_length(tmp_path, foreign, golden):
    short = {name: (column[:-1] if name == "ch2" else column)[:, None] for name, column in foreign.items()}
    scipy.io.savemat(tmp_path / "scope.mat", short)
    with golden.raises(RecordError):
        Record.load(tmp_path / "scope.mat", RIG, mapping=MAP)


@pytest.mark.parametrize("is_within", [False, True])
def test_an_array_of_structures_of_v73_has_the_names_of_v5(tmp_path, foreign, record, is_within):
    """MATLAB stores a set of references a member; of structures within structures too."""
    h5py = pytest.importorskip("h5py")
    values = [{"unit": column} if is_within else column for column in foreign.values()]
    array = np.zeros((1, len(values)), dtype=[("name", object), ("note", object), ("value", object)])
    for k, (name, value) in enumerate(zip(foreign, values, strict=True)):
        array[0, k] = name, np.empty((0, 0)), value
    scipy.io.savemat(tmp_path / "v5.mat", {"ch": array})
    with h5py.File(tmp_path / "v73.mat", "w", userblock_size=512) as file:

        def stored(place, kind, data):
            made = file.create_group(place) if data is None else file.create_dataset(place, data=data)
            made.attrs["MATLAB_class"] = np.bytes_(kind)
            return made

        channels = stored("ch", "struct", None)
        for member in array.dtype.names:
            channels.create_dataset(member, (len(values), 1), dtype=h5py.ref_dtype)
        for k, (name, column) in enumerate(foreign.items()):
            empty = stored(f"#refs#/e{k}", "double", np.zeros(2, dtype=np.uint64))
            empty.attrs["MATLAB_empty"] = np.uint8(1)
            value = stored(f"#refs#/v{k}", "struct" if is_within else "double", None if is_within else column[None, :])
            if is_within:
                stored(f"#refs#/v{k}/unit", "double", column[None, :])
            text = stored(f"#refs#/n{k}", "char", np.array([[ord(letter)] for letter in name], dtype=np.uint16))
            for member, own in (("name", text), ("note", empty), ("value", value)):
                channels[member][k, 0] = own.ref
    with open(tmp_path / "v73.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    end = ".unit" if is_within else ""
    places = {name: f"ch[{k}].value{end}" for k, name in enumerate(foreign, start=1)}
    mapping = {channel: f"{places[own.partition(':')[0]]}:{own.partition(':')[2]}" for channel, own in MAP.items()}
    for own in ("v5", "v73"):
        found = Record.load(tmp_path / f"{own}.mat", RIG, mapping=mapping)
        assert_same(found, record)
        assert "columns_not_used" not in codes(found)
