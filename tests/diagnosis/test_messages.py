"""What stands beside a verdict: the limit that was not kept, what is good enough, what to measure next."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ambid import Model, compare, diagnose, effects, identify, localise, prbs
from ambid.diagnosis.advice import next_steps
from ambid.diagnosis.localisation import Cell
from ambid.diagnosis.messages import findings_of
from ambid.diagnosis.ports import needed_at_ports
from ambid.diagnosis.probabilities import Probabilities
from ambid.diagnosis.verdict import Verdict, share_explained
from ambid.noise import Adequacy, Criterion
from ambid.noise.adequacy import WHEN
from ambid.report.words import left_sentence
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS, record

RIG = ONE_AXIS.rig
TRUE = {"K_i.A_zeta": ONE_AXIS.K_i[0], "K_s.A_zeta": ONE_AXIS.K_s[0], "tau_e": ONE_AXIS.tau_e}
CELL = Cell("run", "y.A_zeta", (18.0, 36.0), 21.6, "linear")
HUM = effects.find("periodic_disturbance")
KEPT_BACK = Criterion("validation", 1.53, 1000.0)


@pytest.fixture(scope="module")
def hum():
    """The true model with a hum that is not there: as adequate as without, in a record that leaves chance little."""
    i_e = prbs(11, amplitude=ONE_AXIS.amplitude, hold=4, periods=3)
    return compare(Model(RIG).with_values(TRUE).add(HUM), measured(RIG, i_e, {}, seed=1, **ONE_AXIS.truth))


@pytest.fixture(scope="module")
def loud():
    """Friction in a record without periods: the misfit is within its limit, and what is left is above the noise."""
    i_e = np.repeat(np.random.default_rng([0, 3]).choice([-1.0, 1.0], (1000, 1)), 4, axis=0)
    friction = {"coulomb_friction": {"force": 3.0, "z": ONE_AXIS.middle}}
    found = identify(RIG, measured(RIG, i_e, friction, seed=0, **ONE_AXIS.truth)).comparison
    assert found.misfit < found.bound
    assert found.adequacy.failed("power")
    return found


@cache
def where(fit):
    """Which takes most of the time."""
    return localise(fit)


def verdict(fit, **facts):
    """An explanation by a hum, but for these facts."""
    usual = Verdict(
        word="explained",
        probabilities=Probabilities(),
        effects=(HUM.name,),
        sets=(),
        fit=fit,
        where=where(fit),
        misfit=1.0,
        tolerance=1.1,
        share=0.99,
        change=None,
        tried=(),
        tried_share=0.0,
        others="",
        is_stopped=False,
        is_chosen=False,
        changes=(),
        remains=None,
        left=fit.adequacy,
        adequacy=fit.adequacy,
    )
    return replace(usual, **facts)


def found(own):
    """The findings beside a verdict, by their codes."""
    return {finding.code: finding for finding in findings_of(own, own.fit.noise, ())}


def test_what_remains_is_reported_with_the_limit_that_it_exceeds(hum, loud):
    left = found(verdict(hum, misfit=1.1004))["mostly_explained"]
    assert (left.values["misfit"], left.values["limit"], left.values["ratio"]) == (1.1004, 1.1, None)
    assert {"1.1004", "1.1000"} <= set(left.message.split())  # with so many digits that they differ
    left = found(verdict(loud, misfit=loud.misfit))["mostly_explained"]
    (power,) = loud.adequacy.failed("power", "motion")
    assert (left.values["misfit"], left.values["ratio"], left.values["most"]) == (None, power.statistic, power.limit)
    assert left.values["when"] == WHEN[power.name]
    assert "mostly_explained" not in found(verdict(hum))


def test_what_is_good_enough_is_not_called_nothing(hum):
    """J/dof 1.093 may be many standard deviations above noise alone."""
    own = verdict(hum, word="adequate", effects=(), misfit=1.093)
    assert hum.by_chance < own.misfit < hum.bound
    shown = found(own)["good_enough"]
    assert (shown.values["misfit"], shown.values["by_chance"], shown.values["tolerance"]) == (1.093, hum.by_chance, 1.1)
    assert shown.values["channel"] == own.where.cells[0].channel
    (step,) = next_steps(own, ())
    assert (step.code, step.values["tolerance"]) == ("next_lower_tolerance", hum.by_chance)
    small = replace(own, misfit=1.02)
    assert "good_enough" not in found(small)
    assert [step.code for step in next_steps(small, ())] == ["next_larger_amplitude"]


def test_a_misfit_of_records_kept_back_is_reported_and_asked_for(hum):
    poor = verdict(hum, left=Adequacy().beside(KEPT_BACK))
    assert found(poor)["validation_above_limit"].values["misfit"] == 1.53
    assert [step.code for step in next_steps(poor, ())] == ["next_diagnose_validation"]
    assert next_steps(replace(poor, word="adequate"), ()) == next_steps(poor, ())
    assert "validation_above_limit" not in found(verdict(hum))


def test_what_is_above_the_noise_within_the_tolerance_is_not_called_missing_physics(loud):
    (power,) = loud.adequacy.failed("power", "motion")
    assert "residual_above_noise" not in found(verdict(loud, tolerance=1.01 * power.statistic))
    assert "residual_above_noise" in found(verdict(loud))


def test_on_one_axis_a_hum_may_come_from_anywhere(hum, demo_estimate):
    assert "disturbance_place_unknown" in found(verdict(hum))
    several = demo_estimate.comparison.of(demo_estimate.model.add(HUM))
    assert "disturbance_place_unknown" not in found(replace(verdict(hum), fit=several))


def test_what_to_do_next_follows_what_is_left_open(hum):
    open_ = {
        "next_judge_residual": {"remains": CELL, "misfit": 1.3},
        "next_nothing": {"others": "operating points"},
        "next_other_point": {"others": "amplitudes"},
        "next_validate_explanation": {},
    }
    for code, facts in open_.items():
        (step,) = next_steps(verdict(hum, **facts), ())
        assert step.code == code
    nameless = verdict(hum, word="none_of_the_candidates", effects=())
    for kind, code in (("drift", "next_repeat_warm"), ("synchronous", "next_record_unexcited")):
        where = replace(nameless.where, cells=(replace(CELL, kind=kind),))
        assert next_steps(replace(nameless, where=where), ())[0].code == code
    (step,) = next_steps(replace(nameless, where=replace(nameless.where, cells=(CELL,))), ())
    assert step.code == "next_other_amplitudes"
    assert step.values == {"channel": "y.A_zeta", "low_hz": 18.0, "high_hz": 36.0, "cell_misfit": 21.6}


def test_each_set_asks_for_an_experiment_of_its_own(hum):
    own = verdict(hum, word="ambiguous", sets=(("loop_delay", "sensor_lag"), ("unbalance", "sensor_runout")))
    steps = next_steps(own, ())
    assert [step.code for step in steps] == ["next_any_experiment"] * 2 + ["next_simulate_experiments"]
    assert [step.values["effects"] for step in steps[:2]] == [list(names) for names in own.sets]


def test_the_sentences_are_those_that_were_read(hum, golden):
    """Of a verdict with all that may stand beside one."""
    facts = {"misfit": 1.3, "left": Adequacy().beside(KEPT_BACK), "is_stopped": True, "remains": CELL}
    some = verdict(hum, **facts)
    none = replace(some, word="none_of_the_candidates", tried=(HUM.name,), tried_share=0.4, is_chosen=True)
    good_enough = verdict(hum, word="adequate", effects=(), misfit=1.093)
    for own in (some, none, replace(good_enough, where=replace(good_enough.where, cells=(CELL,)))):
        shown = (finding for code, finding in found(own).items() if not code.startswith("missing"))  # what is measured
        golden.holds("\n".join(finding.line() for finding in shown))
        golden.holds("\n".join(step.message for step in next_steps(replace(own, left=Adequacy()), ())))


def test_the_share_that_is_explained_lies_between_none_and_all(hum):
    """Of three models: the true one, and two whose K_i is 3 and 6 % off."""
    true = hum.of(hum.model)
    half, wrong = (hum.of(hum.model.with_values({"K_i.A_zeta": f * TRUE["K_i.A_zeta"]})) for f in (1.03, 1.06))
    assert true.cost < half.cost < wrong.cost
    excess = wrong.cost - true.dof
    assert share_explained(wrong, half) == pytest.approx((wrong.cost - half.cost) / excess)
    assert 0.0 < share_explained(wrong, half) < 1.0
    assert share_explained(half, wrong) == 0.0
    assert share_explained(wrong, wrong) == 0.0
    fitted = identify(hum.model, record({}, 1)).comparison
    if fitted.cost < fitted.dof:
        assert share_explained(fitted, fitted) == 1.0
    assert share_explained(wrong, true) == pytest.approx(min(1.0, (wrong.cost - true.cost) / excess))


def test_a_current_that_was_not_recorded_is_not_called_misread(demo_estimate, demo_record):
    recorded = {port.name for port in needed_at_ports(compare(demo_estimate.model, demo_record))}
    without = {port.name for port in needed_at_ports(compare(demo_estimate.model, replace(demo_record, i_c=None)))}
    assert recorded - without == {"reading"}


def test_the_report_says_above_of_the_misfit_alone(loud):
    """What is loud in motion is within the limit of the misfit; a wrong model is above it."""
    right = diagnose(RIG, record({}, 2))
    assert "above" not in left_sentence(replace(right, fit=loud))
    wrong = right.fit.of(right.fit.model.with_values({"K_i.A_zeta": 1.2 * TRUE["K_i.A_zeta"]}))
    assert "above" in left_sentence(replace(right, fit=wrong))
