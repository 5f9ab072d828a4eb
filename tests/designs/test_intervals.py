"""What is foreseen of a record, against many records of virtual experiments."""

from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.designs import Instruments, prospect
from ambid.errors import InputError, RecordError
from ambid.identification import identify_many
from places import LEVITATOR

RIG = ambid.Rig.load(LEVITATOR)
MODEL = ambid.Model(RIG)
SENSOR, CURRENT, PERIODS = 2e-7, 0.01, 8
STATED = Instruments.stated(1, SENSOR, CURRENT)


def sequence(periods=PERIODS):
    return ambid.prbs(7, amplitude=0.3, hold=4, periods=periods)


def experiment(i_e, seed):
    record = MODEL.virtual_experiment(i_e, sensor_noise=SENSOR, current_noise=CURRENT, seed=seed)
    return replace(record, period=len(i_e) // PERIODS)


def errors_of(shown):
    return np.array([p.std_error for p in shown.parameters.values()])


@pytest.mark.parametrize("runs", [20, pytest.param(120, marks=pytest.mark.slow)])
def test_standard_errors_are_those_of_many_records(runs, validated):
    """The scatter of so many runs is itself known to one part in the root of twice their number: three sigmas."""
    i_e = sequence()
    foreseen = errors_of(prospect(MODEL, i_e, period=508, instruments=STATED))
    found = identify_many(RIG, [experiment(i_e, seed) for seed in range(runs)])
    validated(
        "Predicted standard errors of a design, 20 and 120 records: relative deviation",
        "scatter of the estimates; 3 standard deviations of a scatter",
        np.std(found.values, axis=0, ddof=1) / foreseen - 1.0,
        3.0 / np.sqrt(2.0 * runs),
    )


def test_noise_of_a_record_foresees_what_its_statement_does():
    i_e = sequence()
    fit = ambid.identify(RIG, experiment(i_e, 1))
    stated = errors_of(prospect(MODEL, i_e, period=508, instruments=STATED))
    shown = errors_of(prospect(MODEL, i_e, period=508, instruments=Instruments.of(fit.comparison)))
    np.testing.assert_allclose(shown, stated, rtol=0.1)


def test_twice_the_amplitude_or_four_times_the_periods_halve_the_errors():
    base = errors_of(prospect(MODEL, sequence(16), period=508, instruments=STATED))
    louder = errors_of(prospect(MODEL, 2.0 * sequence(16), period=508, instruments=STATED))
    longer = errors_of(prospect(MODEL, sequence(64), period=508, instruments=STATED))
    np.testing.assert_allclose(louder, base / 2.0, rtol=1e-6)
    np.testing.assert_allclose(longer, base / 2.0, rtol=0.02)  # transients take more of few periods


def test_without_currents_less_is_known():
    both = errors_of(prospect(MODEL, sequence(), period=508, instruments=STATED))
    alone = errors_of(prospect(MODEL, sequence(), period=508, instruments=STATED.without_currents()))
    assert (alone > both).all()


def test_noise_between_frequencies_is_straight_and_beyond_them_constant():
    power = np.array([1.0, 3.0])[:, None, None] * np.eye(2)
    own = Instruments(np.array([10.0, 20.0]), power.astype(complex))
    np.testing.assert_allclose(own.at(np.array([0.0, 10.0, 15.0, 20.0, 99.0]))[:, 0, 0].real, [1.0, 1.0, 2.0, 3.0, 3.0])


def test_prospects_refuse(golden):
    with golden.raises(InputError):
        prospect(MODEL, sequence(), period=508 * 8, instruments=STATED)
    with golden.raises(InputError):
        Instruments.stated(1, 0.0, CURRENT)
    record = replace(experiment(sequence(), 1), period=None)
    with golden.raises(RecordError):
        Instruments.of(ambid.compare(MODEL, record))
