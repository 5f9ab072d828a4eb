"""Whole diagnoses of a mass on one axis: what is hidden is named, and what has no name is given none."""

import json

import pytest

from ambid.diagnosis import diagnose, ranking
from ambid.effects import CATALOGUE, channels, find, slips
from ambid.errors import ModelError, UnstableLoopError
from ambid.excitation import prbs
from ambid.noise.chance import ADEQUATE
from hidden.bench import measured
from hidden.one_axis import NAMED, NAMELESS, ONE_AXIS, record
from tiers import first_fast

RIG = ONE_AXIS.rig
FAST = ("force_nonlinearity", "loop_delay")
"""A law, and what acts late."""
ELSEWHERE = {"coulomb_friction", "magnetic_hysteresis"}
"""What other laws of these leave, and what they are told from, is in tests of their own; each takes long."""


def named(found):
    return {*found.effects, *(name for names in found.ambiguous_sets for name in names)}


def test_all_that_makes_sense_on_one_axis_is_hidden_here():
    physics = [effect for effect in CATALOGUE if effect not in (*slips.EFFECTS, *channels.EFFECTS)]
    assert {effect.name for effect in physics if effect.parameters(RIG)} == set(NAMED)


@pytest.mark.parametrize(
    "effect", first_fast(sorted({*NAMED} - ELSEWHERE, key=lambda name: (name not in FAST, name)), len(FAST))
)
def test_a_hidden_effect_is_named_and_the_values_come_right(effect):
    hidden = {effect: NAMED[effect]}
    found = diagnose(RIG, record(hidden, 1), validate=[record(hidden, 2, share=0.8)])
    assert found.verdict in ("explained", "ambiguous"), found
    assert effect in named(found), found
    assert found.history[0].misfit > 1.5
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.1)
    assert found.history[-1].validation_misfit < 1.3
    values = {p.name: p.value for p in found.model.parameters}
    assert values["K_i.A_zeta"] == pytest.approx(ONE_AXIS.K_i[0], rel=0.03)


@pytest.mark.parametrize("seed", first_fast(range(3)))
def test_nothing_hidden_is_adequate(seed):
    found = diagnose(RIG, record({}, seed))
    assert found.verdict == "adequate", found
    assert found.effects == ()
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_chance_on_a_short_record_is_no_missing_physics():
    """With 500 degrees of freedom chance alone brings 1.1; of 20 records at most one may name something."""
    digital = RIG.replace(controller=RIG.controller.model_copy(update={"implementation": "digital"}))
    found = []
    for seed in range(20):
        i_e = prbs(7, amplitude=ONE_AXIS.amplitude, hold=2, periods=8, seed=seed)
        found.append(diagnose(digital, measured(digital, i_e, {}, seed=seed, **ONE_AXIS.truth)))
    assert sum(one.history[0].misfit > ADEQUATE for one in found) >= 2
    assert sum(one.verdict != "adequate" for one in found) <= 1


# the softening of a rate takes a minute; it is in `rates.py`
@pytest.mark.parametrize("effect", first_fast([name for name in NAMELESS if name != "rate_softening"], fast=0))
def test_what_has_no_name_is_given_none(effect):
    found = diagnose(RIG, record({effect: NAMELESS[effect]}, 1))
    assert found.verdict == "none_of_the_candidates", found
    assert found.effects == ()


@pytest.mark.parametrize(
    ("one", "other"), first_fast([("loop_delay", "periodic_disturbance"), ("sensor_lag", "eddy_currents")], 0)
)
def test_two_at_once(one, other):
    found = diagnose(RIG, record({name: NAMED[name] for name in (one, other)}, 1))
    assert {one, other} <= named(found), found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.1)


def test_a_person_may_choose():
    few = [find("sensor_lag"), find("loop_delay")]
    found = diagnose(
        RIG, record({"loop_delay": NAMED["loop_delay"]}, 4), effects=["sensor_lag", "loop_delay"], catalogue=few
    )
    assert "loop_delay" in found.effects
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.1)


def test_a_choice_that_makes_no_stable_loop_beside_an_earlier_one_is_told_what_to_choose_first(monkeypatch):
    alone = ranking.Point.responses

    def responses(point, effect):
        if effect.name == "loop_delay" and "sensor_lag" in [own.name for own in point.exact.effects]:
            raise UnstableLoopError("the closed loop is unstable")
        return alone(point, effect)

    monkeypatch.setattr(ranking.Point, "responses", responses)
    few = [find("sensor_lag"), find("loop_delay")]
    with pytest.raises(ModelError, match=r"loop_delay cannot be added.* is unstable\); choose it before sensor_lag"):
        diagnose(
            RIG, record({"loop_delay": NAMED["loop_delay"]}, 4), effects=["sensor_lag", "loop_delay"], catalogue=few
        )


def test_json_is_as_the_contract_says():
    found = diagnose(RIG, record({"loop_delay": NAMED["loop_delay"]}, 6)).to_json()
    json.dumps(found, allow_nan=False)
    assert {"verdict", "effects", "ambiguous_sets", "history", "where", "parameters", "next_experiment"} <= set(found)
    step = found["history"][0]
    keys = {"effects", "fit_percent", "validation_fit_percent", "misfit", "validation_misfit", "candidates"}
    assert keys <= set(step)
    candidate = {"effect", "score", "p_value", "predicted_value", "predicted_misfit", "confusable_with"}
    assert candidate <= set(step["candidates"][0])
    assert {"channel", "band_hz", "misfit", "kind"} <= set(found["where"][0])
