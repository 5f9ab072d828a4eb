"""Noise that only a recorder has is no fault of the controller, nor of the instants at which channels are read."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Model, Rig, prbs
from ambid.checking import check
from places import BENCH, LEVITATOR

LOUD = 0.4
"""Rms of the noise over that of y: where it were taken for motion, gains would be called wrong."""


@pytest.mark.parametrize("seeds", [1, pytest.param(10, marks=pytest.mark.slow)], ids="seeds: {}".format)
@pytest.mark.parametrize("path", [LEVITATOR, BENCH], ids=["one axis", "four axes"])
def test_noise_of_a_recorder_is_no_fault(path, seeds):
    rig = Rig.load(path)
    analog = rig.controller.model_copy(update={"implementation": "analog", "delay_samples": 0.0})
    rig = rig.replace(controller=analog)
    i_e = prbs(11, amplitude=0.1, periods=8, axes=len(rig.axes))
    still = replace(Model(rig).virtual_experiment(i_e, seed=0, sensor_noise=0.0, current_noise=0.0), period=2047)
    expected = check(rig, still).findings
    for seed in range(seeds):
        noise = LOUD * still.y.std() * np.random.default_rng([seed, 38]).standard_normal(still.y.shape)
        assert check(rig, replace(still, y=still.y + noise)).findings == expected
