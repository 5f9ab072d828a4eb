"""Columns of text, of clocks, or with nothing in them: passed over where nothing names them, an error where it does."""

import numpy as np
import pytest

from ambid import ChannelMap, Record, Rig, StaticLoading
from ambid.errors import RecordError
from found import codes, the
from places import LEVITATOR

RIG = Rig.load(LEVITATOR)
AXIS, RATE = RIG.axes[0], RIG.sample_rate
RNG = np.random.default_rng(3)
COLUMNS = {
    "t": np.arange(600) / RATE,
    f"i_e.{AXIS}": np.tile(0.1 * np.sign(RNG.standard_normal(200)), 3),
    f"y.{AXIS}": 1e-5 * RNG.standard_normal(600),
}
CLOCK = [f"24.11.2026 10:00:{k / RATE:06.4f}" for k in range(600)]


def write(path, columns, separator=",", *, commas=False):
    cells = [[own if isinstance(own, str) else f"{own:.15g}" for own in column] for column in columns.values()]
    if commas:
        cells = [[cell.replace(".", ",") if ":" not in cell else cell for cell in own] for own in cells]
    path.write_text("\n".join(map(separator.join, [list(columns), *zip(*cells, strict=True)])) + "\n")
    return path


UNNAMED = {
    "a word": ({"status": ["OK"] * 600}, ",", False),
    "a clock": ({"Uhrzeit": CLOCK}, ";", False),
    "a clock beside decimal commas": ({"Uhrzeit": CLOCK}, ";", True),
    "nothing": ({"spare": [""] * 600}, ",", False),
    "numbers and one word": ({"speed": [*["0"] * 599, "off"]}, "\t", False),
    "a comma in quotes": ({"note": ['"a, b"'] * 600}, ",", False),
    "two of them": ({"status": ["OK"] * 600, "Uhrzeit": CLOCK}, ",", False),
}


@pytest.mark.parametrize("first", [True, False], ids=["first", "last"])
@pytest.mark.parametrize("name", UNNAMED)
def test_what_nothing_names_is_passed_over(tmp_path, name, first):
    more, separator, commas = UNNAMED[name]
    path = write(tmp_path / "run.csv", more | COLUMNS if first else COLUMNS | more, separator, commas=commas)
    record = Record.load(path, RIG)
    np.testing.assert_allclose(record.y[:, 0], COLUMNS[f"y.{AXIS}"], rtol=1e-13)
    assert the(record, "columns_not_used").values["names"] == list(more)
    assert set(codes(record)) <= {"columns_not_used", "current_not_recorded", "decimal_commas"}


def test_a_column_without_a_name_is_named_by_its_place(tmp_path):
    path = write(tmp_path / "run.csv", {"t": COLUMNS["t"], "": [""] * 600} | COLUMNS)
    assert the(Record.load(path, RIG), "columns_not_used").values["names"] == ["column 2"]


def test_a_map_counts_them_and_lists_them(tmp_path):
    foreign = {"status": ["OK"] * 600, "time": COLUMNS["t"], "a": COLUMNS[f"i_e.{AXIS}"], "b": COLUMNS[f"y.{AXIS}"]}
    mapping = ChannelMap({"t": "2", f"i_e.{AXIS}": "a", f"y.{AXIS}": "4"})
    record = Record.load(write(tmp_path / "run.csv", foreign), RIG, mapping=mapping)
    np.testing.assert_allclose(record.y[:, 0], COLUMNS[f"y.{AXIS}"], rtol=1e-13)
    assert the(record, "columns_not_used").values["names"] == ["status"]


def test_a_table_without_a_header_counts_them(tmp_path):
    path = write(tmp_path / "run.csv", {"status": ["OK"] * 600} | COLUMNS)
    path.write_text(path.read_text().partition("\n")[2])
    mapping = ChannelMap({"t": "2", f"i_e.{AXIS}": "3", f"y.{AXIS}": "4"})
    record = Record.load(path, RIG, mapping=mapping)
    assert record.samples == 600
    assert the(record, "columns_not_used").values["names"] == ["1"]


def test_a_line_of_units_may_have_none_for_them(tmp_path):
    path = write(tmp_path / "run.csv", {"status": ["OK"] * 600} | COLUMNS)
    header, _, rows = path.read_text().partition("\n")
    path.write_text(f"{header}\n,s,A,m\n{rows}")
    assert {"columns_not_used", "units_not_read"} <= set(codes(Record.load(path, RIG)))


@pytest.mark.parametrize("name", ["t", f"y.{AXIS}"])
@pytest.mark.parametrize("cell", ["10:00:00", ""], ids=["clock", "empty"])
def test_what_is_named_stays_an_error(tmp_path, name, cell, golden):
    own = [f"{value:.15g}" for value in COLUMNS[name]]
    own[4] = cell
    with golden.raises(RecordError):
        Record.load(write(tmp_path / "run.csv", COLUMNS | {name: own}), RIG)


def test_a_clock_in_place_of_t_asks_for_the_sample_rate(tmp_path, golden):
    own = {"Time": CLOCK} | {name: column for name, column in COLUMNS.items() if name != "t"}
    path = write(tmp_path / "run.csv", own)
    with golden.raises(RecordError):
        Record.load(path, RIG)
    np.testing.assert_allclose(Record.load(path, RIG, sample_rate=RATE).y[:, 0], COLUMNS[f"y.{AXIS}"], rtol=1e-13)


def test_what_a_map_names_stays_an_error(tmp_path, golden):
    path = write(tmp_path / "run.csv", {"status": ["OK"] * 600} | COLUMNS)
    with golden.raises(RecordError):
        Record.load(path, RIG, mapping={"t": "t", f"y.{AXIS}": "status"})


def test_the_same_of_a_static_loading(tmp_path):
    path = tmp_path / "static.csv"
    rows = "1,0,0,0,0.01,low\n2,0,50,0,0.2,mid\n3,0,90,0,0.4,high"
    path.write_text(f"step,z,F_x,F_y,i_c.{AXIS},remark\n{rows}\n")
    found = StaticLoading.load(path)
    assert found.i_c[:, 0].tolist() == [0.01, 0.2, 0.4]
    assert the(found, "columns_not_used").values["names"] == ["remark"]
