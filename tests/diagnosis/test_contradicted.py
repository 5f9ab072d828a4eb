"""What the record itself, or one that was kept back, contradicts is neither adequate nor explained."""

import numpy as np
import pytest

from ambid import diagnose
from hidden.bench import measured
from hidden.one_axis import NAMELESS, ONE_AXIS, record
from tiers import first_fast

RIG = ONE_AXIS.rig
CURVED = {"cubic_bearing_force": NAMELESS["cubic_bearing_force"]}


@pytest.mark.parametrize("seed", first_fast(range(2)))
def test_what_has_no_name_is_not_lost_in_the_noise_without_periods(seed):
    found = diagnose(RIG, without_periods({"amplifier_dead_band": {"current": 0.002}}, seed))
    assert found.history[0].misfit < 1.1
    assert found.verdict == "none_of_the_candidates", found


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_nor_is_friction_which_has_one(seed):
    found = diagnose(RIG, without_periods({"coulomb_friction": {"force": 3.0, "z": ONE_AXIS.middle}}, seed))
    assert found.history[0].misfit < 1.1
    assert found.effects == ("coulomb_friction",), found


def without_periods(hidden, seed):
    i_e = np.repeat(ONE_AXIS.amplitude * np.random.default_rng([seed, 3]).choice([-1.0, 1.0], (1000, 1)), 4, axis=0)
    return measured(RIG, i_e, hidden, seed=seed, **ONE_AXIS.truth)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_record_kept_back_that_shows_more_forbids_adequate(seed):
    found = diagnose(RIG, record(CURVED, seed, 0.05), validate=record(CURVED, 100 + seed))
    assert found.history[0].misfit < 1.1
    assert found.verdict == "none_of_the_candidates"
    assert "validation_above_limit" in {own.code for own in found.findings}
    assert found.next_step.code == "next_diagnose_validation"


@pytest.mark.parametrize("seeds", [[4], pytest.param(range(10), marks=pytest.mark.slow)], ids=["one", "ten"])
def test_errors_of_a_fit_to_little_do_not(seeds):
    found = [diagnose(RIG, record({}, seed, 0.05), validate=record({}, 1000 + seed)) for seed in seeds]
    assert {own.verdict for own in found} == {"adequate"}
    assert max(own.history[0].validation_misfit for own in found) > 1.1
