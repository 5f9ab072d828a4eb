"""Records: what they hold and note, and every gate refuses its one broken thing."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import scipy.io

from ambid.errors import InputError, RecordError
from ambid.findings import REMARK
from ambid.record import Record
from found import codes, the
from reference.records import (
    AXES,
    MATRICES,
    PERIOD,
    RIG,
    change,
    clipped,
    measured,
    scaled,
    signals_of,
    times,
    write_csv,
)


def test_record_properties_and_repr(golden):
    record = Record.from_arrays(**measured(cut=50), rig=RIG, name="run 7")
    assert (record.samples, record.periods, record.period) == (5 * PERIOD - 50, 4, PERIOD)
    assert record.seconds == pytest.approx(0.122)
    np.testing.assert_allclose(np.diff(record.t), 1e-4)
    for array in (record.y, record.i_e, record.i_c):
        assert array.flags.c_contiguous
        assert not array.flags.writeable
    golden.holds(repr(record))


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
    assert record.findings[0].code == "axes_reordered"
    assert Record.load(path).axes == tuple(AXES[j] for j in order)


def test_i_e_is_rebuilt_on_loading_with_the_rig(tmp_path):
    keywords = measured()
    path = write_csv(tmp_path / "r.csv", {"y": keywords["y"] - keywords["y"].mean(axis=0), "i_c": keywords["i_c"]})
    assert Record.load(path).i_e is None
    assert Record.load(path).excitation_source == "unknown"
    assert Record.load(path).findings[-1].code == "excitation_unknown"
    record = Record.load(path, RIG)
    assert record.i_e.shape == record.y.shape
    assert record.excitation_source == "rebuilt_from_current"
    assert the(record, "excitation_rebuilt").values["source"] == "i_c"


KEEPING = {
    "replace": lambda own: replace(own, findings=()),
    "rows": lambda own: replace(own, findings=()).rows(10, 900),
    "pickle": lambda own: pickle.loads(pickle.dumps(replace(own, findings=()))),
    "another point": lambda own: replace(own, findings=()).at(RIG.replace(speed=10.0)),
}


@pytest.mark.parametrize("what", KEEPING)
def test_where_i_e_is_from_is_data_and_no_finding(what):
    keywords = measured() | {"i_e": None}
    rebuilt = Record.from_arrays(**keywords, rig=RIG)
    kept = KEEPING[what](rebuilt)
    assert (kept.is_rebuilt, kept.excitation_source, kept.findings) == (True, "rebuilt_from_current", ())
    command = Record.from_arrays(**keywords | {"i_ref": keywords["i_c"]}, rig=RIG)
    assert not rebuilt.has_known_command
    assert KEEPING[what](command).has_known_command


@pytest.mark.parametrize("text", ["i_e was not logged: in 2019 it was", "i_e is what was applied by the operator"])
def test_a_remark_that_begins_like_a_finding_changes_nothing(text):
    keywords = measured()
    own = Record.from_arrays(**keywords, i_ref=keywords["i_c"], findings=[REMARK(text=text)])
    assert own.notes[0] == text
    assert (own.is_rebuilt, own.has_known_command, own.excitation_source) == (False, False, "logged")


def test_notes_of_former_scripts_become_findings():
    with pytest.warns(DeprecationWarning, match="notes"):
        own = Record.from_arrays(**measured(), notes=["bench 3"])
    assert own.findings[0] == REMARK(text="bench 3")


BROKEN = {
    "NaN in y": (change("y", (700, 1), np.nan), ["y.A_eta", "nan", "row 701"]),
    "infinite current": (change("i_c", (3, 0), -np.inf), ["i_c.A_zeta", "inf", "row 4"]),
    "NaN in i_e": (change("i_e", (0, 3), np.nan), ["i_e.B_eta", "row 1 "]),
    "dead displacement sensor": (change("y", (slice(None), 2), 1e-6), ["y.B_zeta", "1e-06"]),
    "dead current sensor": (change("i_c", (slice(None), 3), 0.0), ["i_c.B_eta"]),
    "clipped displacement": (clipped("y", 0.6), ["y.B_zeta", "%"]),
    "no excitation": (scaled("i_e", 0.0), ["i_e"]),
    "constant excitation": (change("i_e", slice(None), 0.5), ["0.5"]),
    "y in micrometres": (scaled("y", 1e6), ["y.A_zeta", "0.0005"]),
    "i_c in mA": (scaled("i_c", 1e3), ["i_c.A_zeta", "mA"]),
    "i_e in mA": (scaled("i_e", 1e3), ["i_e.A_zeta", "mA"]),
    "too short": (lambda k: k | {s: k[s][:2] for s in ("i_e", "y", "i_c")}, ["2", "3"]),
    "lengths differ": (lambda k: k | {"i_c": k["i_c"][:-1]}, ["i_c", "(1269, 4)", "(1270, 4)"]),
    "a column too few": (lambda k: k | {"y": k["y"][:, :3]}, ["(1270, 3)", "(1270, 4)"]),
    "one-dimensional": (lambda k: k | {"y": k["y"][:, 0]}, ["(1270,)"]),
    "text": (lambda k: k | {"y": [["a", "b", "c", "d"]] * 300}, []),
    "unknown axis": (lambda k: k | {"axes": (*AXES[:3], "C_eta")}, ["B_eta", "C_eta"]),
    "axis twice": (lambda k: k | {"axes": (*AXES[:3], "A_zeta")}, []),
    "another rate": (lambda k: k | {"sample_rate": 2e4}, ["20000 Hz", "10000 Hz"]),
    "rate off by 0.2 %": (lambda k: k | {"sample_rate": 10020.0}, ["10020", "0.1 %"]),
    "negative rate": (lambda k: k | {"sample_rate": -1e4}, ["-10000"]),
    "period too long": (lambda k: k | {"period": 5000}, ["5000", "1270"]),
    "period of a half": (lambda k: k | {"period": 0.5}, ["0.5"]),
    "nothing to rebuild from": (lambda k: k | {"i_e": None, "i_c": None}, ["i_e", "i_ref", "i_c"]),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_arrays(name, golden):
    broken, values = BROKEN[name]
    with golden.raises(RecordError) as caught:
        Record.from_arrays(**broken(measured()), rig=RIG, name="run")
    for value in ("run: ", *values):
        assert value in str(caught.value)


def test_findings_of_files(tmp_path, golden):
    signals = signals_of(measured())

    def values(path, code):
        return dict(the(Record.load(path, RIG), code).values)

    more = write_csv(tmp_path / "a.csv", signals, extra={"speed": times})
    assert values(more, "columns_not_used") == {"names": ["speed"]}
    late = write_csv(tmp_path / "b.csv", signals, t=times + 3)
    assert values(late, "time_offset") == {"start_s": 3.0}
    jitter = times + np.random.default_rng(0).uniform(-1e-5, 1e-5, times.size)
    jittery = write_csv(tmp_path / "c.csv", signals, t=jitter)
    assert 0.1 < values(jittery, "time_jitter")["share"] < 0.2
    slow = write_csv(tmp_path / "d.csv", signals, t=times * 1.0005)
    assert values(slow, "sample_rate_of_rig") == {"rate_hz": pytest.approx(9995.0, abs=0.01), "rig_rate_hz": 1e4}
    assert Record.load(slow, RIG).sample_rate == 1e4
    rig = RIG.model_copy(update={"sample_rate": 1e5})
    rig.save(tmp_path / "fast.toml")
    with golden.raises(RecordError):
        Record.load(slow, type(RIG).load(tmp_path / "fast.toml"))
    turned = {name: array.T for name, array in signals.items()}
    scipy.io.savemat(tmp_path / "e.mat", MATRICES | turned)
    turned = [own.values["name"] for own in Record.load(tmp_path / "e.mat", RIG).findings]
    assert sorted(turned) == ["i_c", "i_e", "y"]
    scipy.io.savemat(tmp_path / "f.mat", {"fs": 1e4} | signals)
    assert values(tmp_path / "f.mat", "axes_of_rig") == {"axes": AXES}
    with golden.raises(RecordError):
        Record.load(tmp_path / "f.mat")


def test_findings_of_signals(golden):
    keywords = measured()

    def found(own, code, **more):
        return the(Record.from_arrays(**own, rig=RIG, **more), code)

    assert found(keywords | {"i_c": None}, "current_not_recorded").severity == "note"
    still = change("i_e", (slice(None), 1), 0.0)(measured())
    assert found(still, "axis_not_excited").where.axis == "A_eta"
    limited = found(clipped("i_c", 0.6)(measured()), "current_clipped")
    assert limited.where.channel == "i_c.B_zeta"
    assert 0.0 < limited.values["share"] < 0.6
    golden.holds(limited.line())
    assert found(measured(periods=2), "few_periods_found").values["periods"] == 2
    assert found(measured(periods=1), "no_period_found").values["signals"] == ["i_e"]
    assert found(keywords, "few_periods_found", period=2 * PERIOD).values["periods"] == 2


def test_a_stated_period_after_which_nothing_repeats_is_refused(golden):
    with golden.raises(RecordError):
        Record.from_arrays(**measured(), rig=RIG, period=300)
    random = np.random.default_rng(1).standard_normal(measured()["i_e"].shape)
    with golden.raises(RecordError):
        Record.from_arrays(**measured() | {"i_e": 0.1 * random}, rig=RIG, period=300)


def test_a_few_equal_extremes_of_a_short_record_are_not_clipping():
    """A slow channel of a few levels: five samples at the top, one on the level below."""
    keywords = measured(seed=0)
    y = np.round(keywords["y"][:240] / 1e-6) * 1e-6
    top = y[:, 0].max()
    y[:, 0] = np.minimum(y[:, 0], top - 2e-6)
    y[100:105, 0], y[105, 0] = top, top - 1e-6
    short = {key: value[:240] if np.ndim(value) else value for key, value in keywords.items() if key != "y"}
    Record.from_arrays(**short, y=y, rig=RIG)


@pytest.mark.parametrize("seed", range(5))
def test_coarse_converters_are_not_clipped(seed):
    """Signals of few levels also stand at their extremes; that is resolution, not clipping."""
    keywords = measured(seed=seed)
    rng = np.random.default_rng(seed)
    step = np.ptp(keywords["y"]) / rng.uniform(6, 40)
    quantised = keywords | {"y": np.round(keywords["y"] / step) * step}
    assert Record.from_arrays(**quantised, rig=RIG).findings == ()
    sine = 1e-5 * np.sin(np.arange(5 * PERIOD) / rng.uniform(20, 50, 1))
    sine = np.round(sine / 8e-7) * 8e-7
    Record.from_arrays(**keywords | {"y": np.tile(sine[:, None], 4)}, rig=RIG)


def test_beyond_the_air_gap_is_told_and_far_beyond_it_may_be_vouched_for(golden):
    keywords = measured()
    gap = RIG.bearings[0].air_gap
    keywords["y"] = keywords["y"] - keywords["y"].mean(axis=0)
    keywords["y"] = keywords["y"] * (3.0 * gap / np.abs(keywords["y"]).max())
    record = Record.from_arrays(**keywords, rig=RIG)
    beyond = [own for own in record.findings if own.code == "beyond_air_gap"]
    assert max(own.values["largest_m"] for own in beyond) == pytest.approx(3.0 * gap, rel=0.05)
    assert {own.values["air_gap_m"] for own in beyond} <= {bearing.air_gap for bearing in RIG.bearings}
    keywords["y"] = 10.0 * keywords["y"]
    with golden.raises(RecordError):
        Record.from_arrays(**keywords, rig=RIG)
    assert "beyond_air_gap" in codes(Record.from_arrays(**keywords, rig=RIG, allow=["travel"]))
    with golden.raises(InputError):
        Record.from_arrays(**keywords, rig=RIG, allow=["gap"])


def test_the_mean_of_an_absolute_gap_is_no_travel_and_is_told_once():
    keywords = measured()
    gap = RIG.bearings[0].air_gap
    record = Record.from_arrays(**keywords | {"y": keywords["y"] - 1.1 * gap}, rig=RIG)
    (found,) = record.findings
    assert (found.code, found.values["axes"]) == ("mean_left_out", list(AXES))
    assert found.values["means_m"] == pytest.approx(-1.1 * gap + keywords["y"].mean(axis=0))
    assert found.values["air_gaps_m"][0] == gap


def test_currents_above_100_a_are_held_against_the_bias(golden):
    keywords = measured()
    keywords["i_c"] = keywords["i_c"] * (150.0 / keywords["i_c"].std())
    with golden.raises(RecordError):
        Record.from_arrays(**keywords, rig=RIG)
    assert "large_current" in codes(Record.from_arrays(**keywords, rig=RIG, allow=["current"]))
    large = RIG.replace(
        bearings=tuple(
            b.model_copy(update={"bias_current": 40.0, "force_displacement": (1e7,) * len(b.axes)})
            for b in RIG.bearings
        )
    )
    assert "large_current" not in codes(Record.from_arrays(**keywords, rig=large))
