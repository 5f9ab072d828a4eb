"""Files as spreadsheets, oscilloscopes and Simulink write them."""

import numpy as np
import pytest
import scipy.io

from ambid import Record, Rig
from ambid.errors import RecordError
from places import LEVITATOR

RIG = Rig.load(LEVITATOR)
AXIS, RATE = RIG.axes[0], RIG.sample_rate
RNG = np.random.default_rng(1)
COLUMNS = {
    "t": np.arange(600) / RATE,
    f"i_e.{AXIS}": np.tile(0.1 * np.sign(RNG.standard_normal(200)), 3),
    f"y.{AXIS}": 1e-5 * RNG.standard_normal(600),
    f"i_c.{AXIS}": 0.1 * RNG.standard_normal(600),
}


def text(separator: str, above: str = "", below: str = "", *, commas: bool = False) -> str:
    rows = [separator.join(f"{value:.12g}" for value in row) for row in np.column_stack(list(COLUMNS.values()))]
    rows = [row.replace(".", ",") for row in rows] if commas else rows
    return "\n".join([above + separator.join(COLUMNS), *([below] if below else []), *rows]) + "\n"


FILES = {
    "decimal commas": (text(";", commas=True), [("decimal_commas", {})]),
    "decimal commas and tabs": (text("\t", commas=True), [("decimal_commas", {})]),
    "comment with a comma": (text(",", above="# bench 3, 2 May\n"), [("comment_lines", {"count": 1})]),
    "header as a comment": (text(",", above="# "), []),
    "line of units": (text(",", below="s,A,m,A"), [("units_not_read", {"units": ["s", "A", "m", "A"]})]),
    "units in brackets": (
        text(";", below="[s];[A];[m];[A]"),
        [("units_not_read", {"units": ["[s]", "[A]", "[m]", "[A]"]})],
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_table_is_read(tmp_path, name):
    written, found = FILES[name]
    (tmp_path / "own.csv").write_text(written)
    record = Record.load(tmp_path / "own.csv", RIG)
    np.testing.assert_allclose(record.y[:, 0], COLUMNS[f"y.{AXIS}"], rtol=1e-11)
    assert record.period == 200
    assert [(own.code, dict(own.values)) for own in record.findings] == found


def test_two_decimal_marks_are_refused(tmp_path, golden):
    lines = text(";").splitlines()
    lines[5] = lines[5].replace(".", ",")
    (tmp_path / "own.csv").write_text("\n".join(lines))
    with golden.raises(RecordError):
        Record.load(tmp_path / "own.csv", RIG)


def test_a_bad_cell_is_named_by_its_row_whatever_is_above(tmp_path, golden):
    lines = text(";", above="# bench 3\n", below="s;A;m;A", commas=True).splitlines()
    lines[7] = lines[7].replace(";", ";off", 1)
    (tmp_path / "own.csv").write_text("\n".join(lines))
    with golden.raises(RecordError):
        Record.load(tmp_path / "own.csv", RIG)


def test_rows_of_matlab_are_turned(tmp_path):
    rows = {name.partition(".")[0]: values[None, :] for name, values in COLUMNS.items()}
    scipy.io.savemat(tmp_path / "own.mat", rows)
    record = Record.load(tmp_path / "own.mat", RIG)
    np.testing.assert_array_equal(record.y[:, 0], COLUMNS[f"y.{AXIS}"])
    assert "y" in [own.values["name"] for own in record.findings if own.code == "matrix_transposed"]


def test_a_structure_of_simulink_says_how_it_is_mapped(tmp_path, golden):
    values = np.column_stack(list(COLUMNS.values())[1:])
    signals = np.zeros((1, 2), dtype=[("values", object)])
    signals[0, 0]["values"], signals[0, 1]["values"] = values[:, :1], values[:, 1:]
    scipy.io.savemat(tmp_path / "own.mat", {"ML": {"time": COLUMNS["t"], "signals": signals}})
    with golden.raises(RecordError):
        Record.load(tmp_path / "own.mat", RIG)
    names = {"t": "ML.time", f"i_e.{AXIS}": "ML.signals[1].values", f"y.{AXIS}": "ML.signals[2].values[1]"}
    record = Record.load(tmp_path / "own.mat", RIG, mapping=names)
    np.testing.assert_array_equal(record.y[:, 0], values[:, 1])


@pytest.mark.parametrize("unit", ["t [ms]", f"y.{AXIS} (um)"])
def test_a_unit_in_the_name_of_a_column_is_asked_for_as_a_factor(tmp_path, unit, golden):
    name, factor = unit.split()[0], 1e3 if unit.startswith("t") else 1e6
    own = {unit if other == name else other: column for other, column in COLUMNS.items()}
    own[unit] = own[unit] * factor
    rows = np.column_stack(list(own.values()))
    np.savetxt(tmp_path / "own.csv", rows, delimiter=",", header=",".join(own), comments="")
    with golden.raises(RecordError):
        Record.load(tmp_path / "own.csv", RIG)
    mapping = {other: other for other in COLUMNS} | {name: f"{unit}:{1.0 / factor:g}"}
    record = Record.load(tmp_path / "own.csv", RIG, mapping=mapping)
    np.testing.assert_allclose(record.y[:, 0], COLUMNS[f"y.{AXIS}"], rtol=1e-13)


def test_at_1000_hz_milliseconds_are_named_beside_sample_numbers(tmp_path, golden):
    own = RIG.replace(sample_rate=1000.0)
    np.savetxt(
        tmp_path / "own.csv",
        np.column_stack([np.arange(600.0), *list(COLUMNS.values())[1:]]),
        delimiter=",",
        header=",".join(COLUMNS),
        comments="",
    )
    with golden.raises(RecordError):
        Record.load(tmp_path / "own.csv", own)
