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


@pytest.fixture(scope="session", params=["demo", "digital", "saturating"])
def model(request, demo_rig, saturating):
    """A linear analog loop of four axes, a digital one of one axis, and a nonlinear one."""
    if request.param == "saturating":
        return saturating
    return ambid.Model(demo_rig if request.param == "demo" else ambid.Rig.load(LEVITATOR))


@pytest.fixture(scope="session")
def excitation(model):
    """Some hundred samples of all inputs, large enough to saturate."""
    axes = len(model.rig.axes)
    return np.ascontiguousarray(prbs(7, amplitude=1.0, hold=2, axes=axes)[:200])
