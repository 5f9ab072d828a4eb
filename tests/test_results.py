"""Results as tables: in notebooks and for pandas."""

from dataclasses import replace
from html import escape

import numpy as np
import pytest

import ambid
from ambid import results as tables
from ambid.diagnosis import Diagnosis, Step
from ambid.diagnosis.probabilities import Probabilities, SetProbability
from ambid.diagnosis.ranking import NOT_APPLICABLE
from ambid.diagnosis.result import MEND, MOSTLY_EXPLAINED, VERDICTS
from ambid.errors import InputError
from ambid.findings import NOWHERE, REMARK


@pytest.fixture(scope="module")
def comparison(demo_estimate, demo_record):
    return ambid.compare(demo_estimate.model, demo_record)


@pytest.fixture(scope="module")
def ranking(comparison):
    return ambid.rank(comparison, [ambid.effects.find(name) for name in ("loop_delay", "sensor_lag")])


@pytest.fixture(scope="module")
def diagnosis(demo_estimate, demo_record, ranking):
    step = Step((), {"average": 95.0}, None, 0.99, None, None, ranking, {})
    return Diagnosis(
        verdict="adequate",
        effects=(),
        ambiguous_sets=[],
        probabilities=Probabilities((SetProbability((), 0.97, 0.03),)),
        history=[step],
        localisation=None,
        model=demo_estimate.model,
        fit=demo_estimate.comparison,
        kept_back=None,
        parameters=demo_estimate.parameters,
        covariance=demo_estimate.covariance,
        explained_percent=np.nan,
        families={},
        records=(demo_record,),
        validation=(),
        next_steps=(MEND(NOWHERE),),
        seconds=0.0,
        findings=(REMARK(NOWHERE, text="a <note>"),),
    )


@pytest.fixture(params=["demo_estimate", "comparison", "ranking", "diagnosis"])
def result(request):
    return request.getfixturevalue(request.param)


def test_it_converts_to_pandas(result):
    pandas = pytest.importorskip("pandas")
    frame = result.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == list(result.table())
    assert len(frame) > 0


def test_it_shows_itself_in_a_notebook(result):
    html = result._repr_html_()
    assert html.count("<th>") == len(result.table())
    assert html.count("<tr>") == 1 + len(next(iter(result.table().values())))


def test_columns_hold_the_numbers(demo_estimate, comparison, ranking, diagnosis):
    tau_e = demo_estimate.table()
    assert tau_e["parameter"][-1] == "tau_e"
    assert (tau_e["ci95_low"][-1], tau_e["ci95_high"][-1]) == demo_estimate.parameters["tau_e"].ci95
    assert comparison.table()["channel"] == [c.channel for c in comparison.records[0].channels]
    assert np.isfinite(comparison.table()["misfit"]).all()
    assert ranking.table()["effect"] == [c.effect.name for c in ranking.candidates]
    assert diagnosis.table()["misfit"] == [0.99]
    assert diagnosis.table()["validation_misfit"] == [None]


def test_what_is_shown_is_escaped_and_notes_are_told(diagnosis):
    html = diagnosis._repr_html_()
    assert escape(diagnosis.notes[0]) in html
    assert diagnosis.verdict in html


def test_the_parameters_and_what_was_not_tried_are_printed(diagnosis, ranking):
    own = NOT_APPLICABLE(NOWHERE, effect="unbalance", reason="the rotor does not turn")
    (unlisted,) = [replace(ranking, findings=(own,))]
    shown = str(replace(diagnosis, history=[replace(diagnosis.history[0], ranking=unlisted)]))
    low, high = diagnosis.parameters["tau_e"].ci95
    assert f"{low:.6g} .. {high:.6g} s" in shown
    assert own.values["reason"] in next(line for line in shown.splitlines() if "unbalance" in line)


def test_an_explanation_in_the_main_takes_the_place_of_a_whole_one(diagnosis):
    own = {"explained": 0.99, "misfit": 1.3, "limit": 1.1, "ratio": None, "most": None, "when": None}
    mostly = MOSTLY_EXPLAINED(NOWHERE, **own)
    partly = replace(diagnosis, verdict="explained", findings=(mostly, *diagnosis.findings))
    for text in (str(partly), "\n".join(partly.summary()), partly.to_json()["verdict_meaning"]):
        assert text.count(mostly.message) == 1
        assert VERDICTS["explained"] not in text
    assert VERDICTS["explained"] in str(replace(partly, findings=()))


def test_a_parameter_that_is_not_determined_has_an_empty_cell(demo_estimate):
    lost = ambid.ParameterEstimate(None, None, None, "N/A")
    estimate = replace(demo_estimate, parameters={"K_i.A_eta": lost})
    assert estimate.table()["ci95_low"] == [None]


def test_pandas_is_optional(monkeypatch, ranking, golden):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(tables.importlib, "import_module", missing)
    with golden.raises(InputError):
        ranking.to_pandas()


def test_a_diagnosis_is_equal_to_one_that_found_the_same(explained):
    """Whatever time it took."""
    assert replace(explained, seconds=0.0, covariance=explained.covariance.copy()) == explained
    assert replace(explained, covariance=2.0 * explained.covariance) != explained
    assert replace(explained, effects=()) != explained
    assert hash(explained) == hash(replace(explained, seconds=0.0))
