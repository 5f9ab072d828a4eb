"""Models that leave Python, and what they do there."""

import numpy as np
import pytest

import ambid
from ambid.excitation import prbs
from places import LEVITATOR


@pytest.fixture(scope="session")
def saturating(rig):
    """The two-bearing bench whose iron saturates."""
    return ambid.Model(rig).add("flux_saturation")


@pytest.fixture(scope="session")
def digital():
    """A levitator whose controller acts twice in a sample of the record, half a period of its own late."""
    rig = ambid.Rig.load(LEVITATOR)
    own = {"implementation": "digital", "sample_rate": 2 * rig.sample_rate, "delay_samples": 0.5}
    return ambid.Model(rig.replace(controller=rig.controller.model_copy(update=own)))


@pytest.fixture(scope="session", params=["demo", "digital", "saturating"])
def model(request, demo_rig, saturating, digital):
    """A linear analog loop of four axes, a digital one of one axis, and a nonlinear one."""
    made = {"demo": lambda: ambid.Model(demo_rig), "digital": lambda: digital, "saturating": lambda: saturating}
    return made[request.param]()


@pytest.fixture(scope="session")
def excitation(model):
    """Some hundred samples of all inputs, large enough to saturate."""
    axes = len(model.rig.axes)
    return np.ascontiguousarray(prbs(7, amplitude=1.0, hold=2, axes=axes)[:200])
