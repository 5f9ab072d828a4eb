"""Noise that only a recorder has is no fault of the controller, nor of the instants at which channels are read."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import prbs
from ambid.checking import check
from ambid.rig.tolerance import Tolerance
from hidden.bench import simulate
from hidden.dirt import shifted
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS

LOUD = 0.4
"""Rms of the noise over that of y: where it were taken for motion, gains would be called wrong."""


@pytest.mark.parametrize("seeds", [1, pytest.param(2, marks=pytest.mark.slow)], ids="seeds: {}".format)
@pytest.mark.parametrize("own", [ONE_AXIS, BENCHES["bench"]], ids=["one axis", "four axes"])
def test_noise_of_a_recorder_is_no_fault(own, seeds):
    i_e = prbs(10, amplitude=0.1, periods=6, axes=len(own.rig.axes))
    still = simulate(own.rig, i_e, seed=None, period=1023, **own.truth)
    expected = check(own.rig, still).findings
    assert not [found for found in expected if found.where.record]
    for seed in range(seeds):
        noise = LOUD * still.y.std() * np.random.default_rng([seed, 38]).standard_normal(still.y.shape)
        assert check(own.rig, replace(still, y=still.y + noise)).findings == expected


HEARD = 0.04
"""The same where it only makes some of i_c uncertain."""


@pytest.mark.parametrize("seed", range(3))
def test_a_gain_of_one_sensor_is_told_below_what_noise_makes_of_the_current(seed):
    """5 % of the half of i_c that y makes."""
    own = BENCHES["bench"]
    record = simulate(own.rig, prbs(10, amplitude=0.1, periods=6, axes=4), seed=None, period=1023, **own.truth)
    noise = HEARD * record.y.std() * np.random.default_rng([seed, 39]).standard_normal(record.y.shape)
    y = record.y * [1.05, 1.0, 1.0, 1.0] + noise
    (found,) = [own for own in check(own.rig, replace(record, y=y)).findings if own.code == "gains_differ"]
    assert found.values["axes"] == ["A_zeta"]
    assert found.values["factors"]["y"]["A_zeta"] == pytest.approx(1.0 / 1.05, abs=0.02)
    # sensors that nobody has calibrated may be so far off
    uncalibrated = own.rig.replace(tolerance=Tolerance(sensor_gain=0.05))
    assert not [own for own in check(uncalibrated, replace(record, y=y)).findings if own.code == "gains_differ"]


@pytest.mark.parametrize("seed", range(3))
def test_one_clock_of_all_sensors_is_told_where_noise_hides_that_of_each(seed):
    """Few lines are clear of noise on any axis."""
    own = BENCHES["bench"]
    record = simulate(own.rig, prbs(10, amplitude=0.1, periods=6, axes=4), seed=None, period=1023, **own.truth)
    noise = HEARD * record.y.std() * np.random.default_rng([seed, 40]).standard_normal(record.y.shape)
    y = shifted(np.array(record.y), 0.3) + noise
    (found,) = check(own.rig, replace(record, y=y)).errors
    assert (found.code, found.values["signal"], found.values["axes"]) == ("channel_delay", "y", list(record.axes))
    assert found.values["delay_samples"] == pytest.approx(0.3, abs=0.1)
