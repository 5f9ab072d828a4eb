"""The smallest size of an effect that an experiment shows, and what it could be taken for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import ambid
from ambid.designs import Instruments, prospect, visible
from places import BENCH, LEVITATOR

RIG = ambid.Rig.load(LEVITATOR)
MODEL = ambid.Model(RIG)
SENSOR, CURRENT, PERIODS = 2e-7, 0.01, 8
STATED = Instruments.stated(1, SENSOR, CURRENT)


def shown(i_e, model=MODEL, instruments=STATED, periods=PERIODS):
    return visible(prospect(model, i_e, period=len(i_e) // periods, instruments=instruments).comparison)


def sequence(amplitude=0.3, periods=PERIODS, axes=1):
    return ambid.prbs(8, amplitude=amplitude, hold=2, periods=periods, axes=axes)


@pytest.mark.slow
def test_an_effect_of_that_size_is_named_in_half_of_all_records():
    """So many of 16 as in all but one of 10 000 trials."""
    own = shown(sequence()).find("sensor_lag")
    truth = MODEL.add("sensor_lag", {own.parameter: own.size})
    names = ("sensor_lag", "loop_delay", "amplifier_bandwidth", "sampling_skew", "eddy_currents")
    lags = [ambid.effects.find(name) for name in names]
    count, seeds = 0, 16
    for seed in range(seeds):
        record = truth.virtual_experiment(sequence(), sensor_noise=SENSOR, current_noise=CURRENT, seed=seed)
        count += "sensor_lag" in ambid.diagnose(RIG, replace(record, period=510), catalogue=lags).effects
    few, many = binom.ppf([5e-5, 1.0 - 5e-5], seeds, 0.5)
    assert few <= count <= many


def test_twice_the_amplitude_shows_half_of_what_is_linear_and_less_of_what_grows_faster():
    once, twice = shown(sequence()), shown(sequence(0.6))
    for name in ("loop_delay", "sensor_lag", "excitation_gain_error"):
        np.testing.assert_allclose(twice.find(name).size, once.find(name).size / 2.0, rtol=1e-3)
    loud, louder = shown(sequence(2.0)), shown(sequence(4.0))
    assert louder.find("force_nonlinearity").size < loud.find("force_nonlinearity").size / 2.0


@pytest.mark.slow
def test_a_nonlinear_effect_of_its_size_has_the_score_of_a_linear_one():
    """The response at that size is simulated, not extended from another."""
    own = shown(sequence(2.0)).find("force_nonlinearity")
    truth = MODEL.add(ambid.effects.find("force_nonlinearity", own.settings), {"bias_ratio": own.size})
    scores = []
    for seed in range(10):
        record = truth.virtual_experiment(sequence(2.0), sensor_noise=SENSOR, current_noise=CURRENT, seed=seed)
        ranking = ambid.rank(ambid.identify(RIG, replace(record, period=510)).comparison)
        scores.append(ranking.find("force_nonlinearity").score)
    assert 8.0 < np.mean(scores) < 25.0


def test_without_currents_two_lags_look_alike_and_with_them_they_do_not():
    both, alone = shown(sequence()), shown(sequence(), instruments=STATED.without_currents())
    assert "sensor_lag" not in both.find("loop_delay").twins
    assert alone.find("loop_delay").twins["sensor_lag"] > 10.0


def test_what_is_not_shown_has_its_reason(golden):
    found = shown(sequence())
    golden.holds(found.not_shown["seal_forces"])
    assert found.find("seal_forces") is None
    output = shown(sequence(), instruments=STATED.without_currents())
    golden.holds(output.not_shown["sampling_skew"])
    named = {own.effect for own in found.effects} | set(found.not_shown)
    assert named == {effect.name for effect in ambid.CATALOGUE}


@pytest.fixture(scope="module")
def four_axes():
    """What few and many periods show."""
    model, instruments = ambid.Model(ambid.Rig.load(BENCH)), Instruments.stated(4, 50e-9, CURRENT)
    few, many = (shown(ambid.prbs(8, amplitude=0.2, hold=2, axes=4, periods=n), model, instruments, n) for n in (8, 32))
    return few, many


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sensor_gain_error", "axis_cross_coupling", "seal_forces"])
def test_on_four_axes_sizes_fall_with_the_root_of_the_periods(name, four_axes):
    few, many = (own.find(name) for own in four_axes)
    np.testing.assert_allclose(many.size, few.size / 2.0, rtol=0.05)
