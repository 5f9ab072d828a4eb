"""What a diagnosis says in words: one of two sentences that contradict each other, the bound that is meant, shares."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ambid import Model, compare, effects
from ambid.diagnosis.localisation import Cell
from ambid.diagnosis.ports import needed_at_ports
from ambid.diagnosis.state import State
from ambid.diagnosis.verdict import Verdict
from ambid.diagnosis.wording import next_experiment, notes
from ambid.report.words import left_sentence
from ambid.results import told_apart
from ambid.rig import Rig
from places import LEVITATOR

QUIET = SimpleNamespace(parts=())


def verdict(model, **keys):
    """An explanation in the facts that `notes` reads."""
    fit = SimpleNamespace(model=model, records=(), bound=1.1, by_chance=1.03, loudest=1.0, when_loudest="")
    own = {"word": "explained", "effects": ("periodic_disturbance",), "sets": (), "fit": fit, "misfit": 1.0}
    own |= {"tolerance": 1.1, "share": 0.99, "change": None, "changes": (), "is_stopped": False, "is_chosen": False}
    own |= {"kept_back": None, "shape": ""}
    own = dict.fromkeys(Verdict.__annotations__, ()) | own | keys
    return Verdict(**own)


@pytest.fixture(scope="module")
def hum():
    rig = Rig.load(LEVITATOR)
    (effect,) = [own for own in effects.CATALOGUE if own.name == "periodic_disturbance"]
    return Model(rig).add(effect)


def test_what_remains_is_told_with_the_bound_that_it_failed(hum):
    (left, *_) = notes(verdict(hum, misfit=1.1004), QUIET)
    assert left.startswith("in the main only")
    assert "J/dof 1.1004 remains, above its bound 1.1000" in left
    loud = SimpleNamespace(model=hum, records=(), bound=1.2, loudest=1.7, when_loudest="while the machine moves")
    (left, *_) = notes(verdict(hum, misfit=1.15, fit=loud), QUIET)
    assert "1.70 times the noise remains while the machine moves, above 1.10" in left
    assert not any("in the main" in note for note in notes(verdict(hum), QUIET))


def test_what_is_good_enough_is_not_called_nothing(hum):
    """J/dof 1.093 of 20 000 degrees of freedom is ten standard deviations above noise alone."""
    where = SimpleNamespace(cells=[Cell("run", "y.A_zeta", (18.0, 36.0), 21.6, "linear")], sentence=lambda: "")
    keys = {"word": "adequate", "effects": (), "where": where}
    (told, *_) = notes(verdict(hum, misfit=1.093, **keys), QUIET)
    assert told.startswith("good enough: J/dof 1.09 remains, within the 1.10 that is asked for, but above the 1.03")
    assert "most of it in y.A_zeta from 18 to 36 Hz (21.6 times noise)" in told
    assert next_experiment(verdict(hum, misfit=1.093, **keys), ()).endswith(
        "look for what is left with --tolerance 1.03"
    )
    assert not any("good enough" in note for note in notes(verdict(hum, misfit=1.02, **keys), QUIET))
    assert next_experiment(verdict(hum, misfit=1.02, **keys), ()).startswith("nothing is needed")


def test_a_misfit_of_records_kept_back_is_told_and_asked_for(hum):
    poor = verdict(hum, kept_back=1.53)
    assert any(note.startswith("on the records to validate on the misfit is 1.53") for note in notes(poor, QUIET))
    assert next_experiment(poor, ()) == next_experiment(verdict(hum, word="adequate", kept_back=1.53), ())
    assert "together with these" in next_experiment(poor, ())
    assert not any("validate" in note for note in notes(verdict(hum), QUIET))


def test_the_louder_motion_of_an_adequate_model_is_not_called_missing_physics(hum):
    held = [SimpleNamespace(uneven="", louder="physics is missing")]
    for loudest, told in ((1.05, 0), (1.7, 1)):
        fit = SimpleNamespace(model=hum, records=held, bound=1.1, loudest=loudest, when_loudest="over all lines")
        assert list(notes(verdict(hum, fit=fit), QUIET)).count("physics is missing") == told


def test_on_one_axis_a_hum_is_said_to_come_from_anywhere(hum, demo_estimate):
    assert any("on one axis a force, a current and a hum of the sensor" in note for note in notes(verdict(hum), QUIET))
    several = demo_estimate.model.add(hum.effects[0])
    assert not any("one axis" in note for note in notes(verdict(several), QUIET))


@pytest.mark.parametrize(
    ("base", "fit", "share"), [(300.0, 100.0, 1.0), (300.0, 90.0, 1.0), (300.0, 150.0, 0.75), (101.0, 105.0, 0.0)]
)
def test_the_share_that_is_explained_lies_between_none_and_all(base, fit, share):
    state = State(*(SimpleNamespace(cost=cost, dof=100) for cost in (base, 101.0, fit)))
    assert state.explained == share
    assert State(*(SimpleNamespace(cost=cost, dof=100) for cost in (99.0, 99.0, 95.0))).explained == 1.0


def test_a_current_that_was_not_recorded_is_not_said_to_be_misread(demo_estimate, demo_record):
    recorded = {port.name for port in needed_at_ports(compare(demo_estimate.model, demo_record))}
    without = {port.name for port in needed_at_ports(compare(demo_estimate.model, replace(demo_record, i_c=None)))}
    assert recorded - without == {"reading"}


def test_digits_are_enough_to_see_which_is_larger():
    assert told_apart(1.7, 1.1) == ("1.70", "1.10")
    assert told_apart(1.10004, 1.1) == ("1.10004", "1.10000")


def test_the_report_says_above_of_the_bound_alone():
    cells = SimpleNamespace(misfit=np.ones((1, 1)), by_chance=2.0 * np.ones(1))
    for value, word in ((1.07, "within"), (1.2, "above")):
        fit = SimpleNamespace(misfit=value, bound=1.1, is_adequate=False)  # louder in motion
        assert f"{word} its bound" in left_sentence(SimpleNamespace(fit=fit, left=[cells]))
