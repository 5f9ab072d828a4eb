"""A measurement that is given twice, by whatever name: a note names both files; other data under one name are fine."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid import Model, Record, StaticLoading, prbs, static_load
from ambid.demo import DATA
from ambid.record import measured
from ambid.record.measurement import (
    findings_of_loadings,
    findings_of_repeats,
    findings_of_validation,
    with_repeats_found,
)
from found import codes, the
from hidden.one_axis import ONE_AXIS

RIG = ONE_AXIS.rig


def run(seed: int, name: str = "run") -> Record:
    return replace(
        Model(RIG).virtual_experiment(prbs(8, amplitude=1.0, hold=4, axes=1, periods=4), seed=seed), name=name
    )


@pytest.fixture
def files(tmp_path):
    """A record, its copy by another name and in another format, and another record of the same name elsewhere."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    RIG.save(tmp_path / "rig.toml")
    run(1).save(tmp_path / "a" / "run.csv")
    shutil.copy(tmp_path / "a" / "run.csv", tmp_path / "a" / "again.csv")
    run(1).save(tmp_path / "a" / "run.mat")
    run(2).save(tmp_path / "b" / "run.csv")
    return tmp_path


@pytest.mark.parametrize("other", ["a/run.csv", "a/again.csv", "a/run.mat"])
def test_a_record_that_is_given_twice_is_told_with_both_files(files, other):
    estimate = ambid.identify(RIG, [files / "a" / "run.csv", files / other])
    found = the(estimate.records[1], "counted_twice")
    assert dict(found.values) == {"source": str(files / other), "other": str(files / "a" / "run.csv")}
    assert sum(found.message in note for note in estimate.notes) == 1


def test_other_data_of_the_same_name_are_fine(files):
    several = measured([files / "a" / "run.csv", files / "b" / "run.csv"], RIG)
    assert "counted_twice" not in [code for own in several for code in codes(own)]


def test_the_same_motion_by_another_excitation_is_another_record():
    own = run(1)
    assert with_repeats_found([own, replace(own, i_e=2.0 * own.i_e)])[1].findings == own.findings


def test_two_instruments_beside_one_excitation_are_two_records():
    own = run(1)
    current = replace(own, y=np.zeros((own.samples, 0)))
    assert with_repeats_found([replace(own, i_c=None), current])[1].findings == current.findings


def test_a_frequency_response_that_is_given_twice_is_told():
    own = run(1).frequency_response()
    first, second = with_repeats_found([own, replace(own, name="again")])
    assert "counted_twice" not in codes(first)
    assert dict(the(second, "counted_twice").values) == {"source": "again", "other": "run"}


def test_it_is_told_once_however_often_it_is_asked():
    shown = with_repeats_found(with_repeats_found([run(1), run(1, "again")]))
    assert codes(shown[1]).count("counted_twice") == 1


def test_validation_on_the_record_that_was_fitted_is_told(files):
    train, same, new = (files / place for place in ("a/run.csv", "a/again.csv", "b/run.csv"))
    found = ambid.diagnose(RIG, train, validate=[same, new])
    (own,) = findings_of_validation(found.records, found.validation)
    assert dict(own.values) == {"source": str(same), "other": str(train)}
    assert sum(own.message in note for note in found.notes) == 1
    assert findings_of_validation([run(1)], [run(2)]) == []


@pytest.mark.parametrize("what", ["identify", "compare", "rank"])
def test_commands_say_so(files, what, command):
    records = files / "a" / "run.csv", files / "a" / "again.csv"
    found = command(what, files / "rig.toml", *records, "--json", files / "out.json")
    (twice,) = findings_of_repeats(measured(records, RIG))
    assert twice.message in found.out
    assert json.dumps(twice.message)[1:-1] in (files / "out.json").read_text()


def test_a_static_loading_that_is_given_twice_is_told(tmp_path):
    rig = ambid.Rig.load(DATA / "rig.toml")
    shutil.copy(DATA / "static_1.csv", tmp_path / "again.csv")
    found = static_load(rig, [DATA / "static_1.csv", tmp_path / "again.csv"])
    (twice,) = findings_of_loadings(found.loadings)
    assert dict(twice.values) == {"source": str(tmp_path / "again.csv"), "other": str(DATA / "static_1.csv")}
    assert sum(twice.message in note for note in found.notes) == 1
    one = StaticLoading.load(DATA / "static_1.csv", rig)
    other = replace(one, i_c=one.i_c * 1.01 + 1e-3 * np.arange(len(one.i_c))[:, None])
    assert findings_of_loadings([one, other]) == []
