"""Channels beyond y and i_c: flux density, force, acceleration, displacement at further places."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import scipy.io

import ambid
from ambid.channels import FURTHER, SIGNALS, SensorSignal, in_order, read_in, unit_of
from ambid.errors import InputError, RecordError, RigError
from ambid.loop.plant import MOTION
from ambid.record import Record
from ambid.rig import Rig
from found import the
from places import BENCH, LEVITATOR

AXIS = "A_zeta"


def instrumented(path=LEVITATOR, **more) -> Rig:
    """A rig with Hall sensors, an accelerometer and a further displacement sensor."""
    data = Rig.load(path).model_dump(by_alias=True, exclude_none=True)
    for bearing in data["bearing"]:
        bearing["pole_area"] = 3e-4
    place = {} if path == LEVITATOR else {"position": 0.4}
    data["sensor"] = [
        {"signal": "a", "name": "middle", **place},
        {"signal": "y", "name": "far", "direction": 30.0, **place},
    ]
    return Rig(**data | more)


RIG = instrumented()
CHANNELS = {"y.far": 1e-5, f"b.{AXIS}": 0.2, f"f.{AXIS}": 50.0, "a.middle": 3.0}
"""With a typical size of each."""


@pytest.fixture(scope="module")
def record() -> Record:
    """Five periods of noise, the same in every period but for a hundredth."""
    random = np.random.default_rng(0)
    own = {"i_e": 1.0, "y": 1e-5, "i_c": 1.0} | CHANNELS
    period = {name: size * random.standard_normal(400) for name, size in own.items()}
    held = np.repeat(random.choice([-1.0, 1.0], 100), 4)
    columns = {name: np.tile(x, 5) + 0.01 * own[name] * random.standard_normal(2000) for name, x in period.items()}
    return Record.from_arrays(
        i_e=np.tile(held, 5)[:, None],
        y=columns["y"][:, None],
        i_c=columns["i_c"][:, None],
        further={name: columns[name] for name in CHANNELS},
        sample_rate=1e4,
        axes=[AXIS],
        rig=RIG,
    )


def arrays(record: Record, **changed) -> dict:
    own = {name: getattr(record, name) for name in ("i_e", "y", "i_c", "sample_rate", "axes")}
    return own | {"further": dict(record.further) | changed, "rig": RIG}


def test_channels_are_in_the_order_of_the_list_whatever_the_order_they_come_in(record):
    assert record.channels == [f"y.{AXIS}", f"i_c.{AXIS}", "y.far", f"b.{AXIS}", f"f.{AXIS}", "a.middle"]
    assert record.outputs.shape == (2000, 6)
    assert in_order(["a.x", "b.B", "b.A"], ["A", "B"]) == ["b.A", "b.B", "a.x"]
    assert not record.further["a.middle"].flags.writeable


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".parquet", ".tdms"])
def test_files_give_back_what_was_saved(record, suffix, tmp_path):
    record.save(tmp_path / f"own{suffix}")
    again = Record.load(tmp_path / f"own{suffix}", RIG)
    assert again.channels == record.channels
    np.testing.assert_array_equal(again.outputs, record.outputs)


def test_matrices_of_axes_and_of_sensors(record, tmp_path, golden):
    own = {"fs": 1e4, "i_e": record.i_e, "y": record.y, "axes": np.array([AXIS], dtype=object)}
    scipy.io.savemat(tmp_path / "own.mat", own | {"b": record.further[f"b.{AXIS}"][:, None]})
    assert Record.load(tmp_path / "own.mat", RIG).channels == [f"y.{AXIS}", f"b.{AXIS}"]
    scipy.io.savemat(tmp_path / "own.mat", own | {"a": record.further["a.middle"][:, None]})
    assert Record.load(tmp_path / "own.mat", RIG).channels == [f"y.{AXIS}", "a.middle"]
    scipy.io.savemat(tmp_path / "own.mat", own | {"a": np.zeros((2000, 3))})
    with golden.raises(RecordError):
        Record.load(tmp_path / "own.mat", RIG)


def test_a_map_makes_si_units_of_foreign_names(record, tmp_path, golden):
    table = np.column_stack([record.t, record.i_e, record.y, 1e3 * record.further[f"b.{AXIS}"]])
    np.savetxt(tmp_path / "own.csv", table, delimiter=",", header="time,e,gap,hall", comments="")
    mapping = {"t": "time", f"i_e.{AXIS}": "e", f"y.{AXIS}": "gap", f"b.{AXIS}": "hall:1e-3"}
    again = Record.load(tmp_path / "own.csv", RIG, mapping=mapping)
    np.testing.assert_allclose(again.further[f"b.{AXIS}"], record.further[f"b.{AXIS}"], rtol=1e-12)
    with golden.raises(InputError):
        Record.load(tmp_path / "own.csv", RIG, mapping=mapping | {"c.A_zeta": "hall"})


@pytest.mark.parametrize("channel", CHANNELS)
def test_each_channel_passes_the_gates(record, channel, golden):
    values = record.further[channel]
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record, **{channel: np.where(np.arange(2000) == 7, np.nan, values)}))
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record, **{channel: np.full(2000, values[0])}))
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record, **{channel: np.where(np.arange(2000) < 200, values[0], values)}))
    limit = 0.5 * CHANNELS[channel]
    clipped = np.repeat(np.clip(values, -limit, limit), 3)[:2000]
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record, **{channel: clipped}))
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record, **{channel: values[1:]}))


def test_a_spike_is_mended_and_lost_rows_go_with_the_rest(record):
    values = np.array(record.further["a.middle"])
    values[1010] = 90.0
    mended = Record.from_arrays(**arrays(record, **{"a.middle": values}))
    found = the(mended, "spikes")
    assert found.where.channel == "a.middle"
    assert found.values["unit"] == "m/s^2"
    assert abs(mended.further["a.middle"][1010]) < 15.0
    kept = np.delete(np.arange(2000), [1003, 1004])
    own = {name: value[kept] if isinstance(value, np.ndarray) else value for name, value in arrays(record).items()}
    own["further"] = {name: column[kept] for name, column in record.further.items()}
    cut = Record.from_arrays(**own)
    assert the(cut, "rows_lost")
    assert {len(column) for column in cut.further.values()} == {cut.samples}
    assert record.rows(5, 25).further["a.middle"].tolist() == record.further["a.middle"][5:25].tolist()


@pytest.mark.parametrize("channel", ["b.B_zeta", "a.end", "u.A_zeta", "c.A_zeta", "i_e.A_zeta", "y.A_zeta"])
def test_channels_that_the_rig_has_not(record, channel, golden):
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record, **{channel: record.further["a.middle"]}))


def test_flux_density_needs_a_pole_and_looks_like_mt(record, golden):
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record) | {"rig": Rig.load(LEVITATOR), "further": {f"b.{AXIS}": record.y[:, 0]}})
    with golden.raises(RecordError):
        Record.from_arrays(**arrays(record, **{f"b.{AXIS}": 1e3 * record.further[f"b.{AXIS}"]}))


@pytest.mark.parametrize(
    "sensor",
    [
        {"position": 0.4, "name": "A_zeta"},
        {"position": 0.4, "name": "far"},
        {"position": 0.4, "name": "a b"},
        {"name": "end"},
        {"position": 40.0, "name": "end"},
        {"position": 0.4, "name": "end", "direction": 400.0},
        {"position": 0.4, "name": "end", "signal": "b"},
    ],
    ids=str,
)
def test_slips_in_a_sensor(sensor, golden):
    data = instrumented(BENCH).model_dump(by_alias=True, exclude_none=True)
    data["sensor"] = (*data["sensor"], {"signal": "a"} | sensor)
    with golden.raises(RigError):
        Rig(**data)


@pytest.mark.parametrize(
    ("key", "value"),
    [("pole_area", 300.0), ("bias_flux", 400.0), ("bias_flux", (0.3, 0.3)), ("pole_area", -1e-4)],
    ids=str,
)
def test_slips_in_a_pole(key, value, golden):
    data = Rig.load(LEVITATOR).model_dump(by_alias=True, exclude_none=True)
    data["bearing"][0][key] = value
    with golden.raises(RigError):
        Rig(**data)


def test_area_and_bias_flux_follow_from_each_other():
    by_area = RIG.bearings[0]
    both = by_area.model_copy(
        update={"bias_flux": (by_area.force_current[0] * 4.0 / (2.0 * by_area.force_per_flux[0]),)}
    )
    by_flux = both.model_copy(update={"pole_area": None})
    assert both.force_per_flux == pytest.approx(by_area.force_per_flux)
    assert by_flux.force_per_flux == pytest.approx(by_area.force_per_flux)


def test_a_rig_with_sensors_is_written_and_read():
    rig = instrumented(BENCH, tolerance={"flux_gain": 0.02})
    assert Rig.from_toml(rig.to_toml()) == rig
    assert rig.known_to("flux_gain") == 0.02
    assert rig.outputs[-2:] == ("a.middle", "y.far")


def test_units_are_those_of_the_list():
    assert unit_of("b.A_zeta") == "T"
    assert {read_in(f"{SIGNALS[name].unit}/A") for name in FURTHER} == {
        (1e3, "mT/A"),
        (1.0, "V/A"),
        (1.0, "N/A"),
        (1.0, "m/s^2/A"),
    }


def test_a_signal_of_sensors_is_known_to_the_list_the_plant_and_the_tolerances_alone():
    of_sensors = {name for name, own in SIGNALS.items() if "sensor" in own.at}
    assert of_sensors == set(get_args(SensorSignal)) == set(MOTION)
    room = Path(ambid.__file__).parent
    naming = {p.relative_to(room).as_posix() for p in room.rglob("*.py") if SIGNALS["a"].gain in p.read_text()}
    assert naming == {"channels.py", "rig/tolerance.py"}


def test_without_further_channels_nothing_is_there(record):
    plain = replace(record, further={})
    assert plain.channels == [f"y.{AXIS}", f"i_c.{AXIS}"]
    assert "b" not in repr(plain).split(";")[1].split()
