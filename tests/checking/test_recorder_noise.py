"""Noise that only a recorder has is no fault of the controller, nor of the instants at which channels are read."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import prbs
from ambid.checking import check
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS

LOUD = 0.4
"""Rms of the noise over that of y: where it were taken for motion, gains would be called wrong."""


@pytest.mark.parametrize("seeds", [1, pytest.param(10, marks=pytest.mark.slow)], ids="seeds: {}".format)
@pytest.mark.parametrize("own", [ONE_AXIS, BENCHES["bench"]], ids=["one axis", "four axes"])
def test_noise_of_a_recorder_is_no_fault(own, seeds):
    i_e = prbs(10, amplitude=0.1, periods=6, axes=len(own.rig.axes))
    still = simulate(own.rig, i_e, seed=None, period=1023, **own.truth)
    expected = check(own.rig, still).findings
    assert not [found for found in expected if found.where.record]
    for seed in range(seeds):
        noise = LOUD * still.y.std() * np.random.default_rng([seed, 38]).standard_normal(still.y.shape)
        assert check(own.rig, replace(still, y=still.y + noise)).findings == expected
