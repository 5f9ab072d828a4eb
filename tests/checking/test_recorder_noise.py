"""Noise that only a recorder has is no fault of the controller, nor of the instants at which channels are read."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Model, Rig, prbs
from ambid.checking import check
from places import BENCH, LEVITATOR


@pytest.mark.parametrize("seeds", [2, pytest.param(20, marks=pytest.mark.slow)], ids="{} seeds".format)
@pytest.mark.parametrize("path", [LEVITATOR, BENCH], ids=["one axis", "four axes"])
def test_noise_of_a_recorder_is_no_fault(path, seeds):
    rig = Rig.load(path)
    axes = len(rig.axes)
    i_e = prbs(11, amplitude=0.1, periods=8, axes=axes)
    still = Model(rig).virtual_experiment(i_e, seed=0, sensor_noise=0.0, current_noise=0.0)
    expected = check(rig, replace(still, period=2047)).findings
    for seed in range(seeds):
        random = np.random.default_rng([seed, 38])
        noise = random.standard_normal((2, *still.y.shape)) * np.array([0.04, 0.02])[:, None, None]
        heard = replace(
            still, period=2047, y=still.y + noise[0] * still.y.std(), i_c=still.i_c + noise[1] * still.i_c.std()
        )
        assert check(rig, heard).findings == expected
