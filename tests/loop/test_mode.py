"""The error of an unstable loop names what the growing pole moves."""

import numpy as np
import pytest

from ambid import Model
from ambid.errors import UnstableLoopError
from virtual import VirtualBench


@pytest.fixture(scope="module")
def rig():
    return VirtualBench().rig()


def shown(rig):
    model = Model(rig)
    with pytest.raises(UnstableLoopError) as caught:
        model.simulate(np.zeros((10, len(rig.axes))))
    return str(caught.value)


def pid(rig, **changes):
    return rig.replace(controller=rig.controller.model_copy(update=changes))


def test_without_stiffness_the_rigid_body_falls(rig, golden):
    weak = pid(rig, proportional=0.3 * rig.controller.proportional, integral=0.0)
    golden.holds(shown(weak))


def test_a_mode_that_the_controller_drives_is_named_with_its_frequency(rig, golden):
    """A derivative of the wrong sign at the mode: its nominal damping is taken away."""
    modes = rig.rotor
    undamped = modes.model_copy(update={"damping": tuple(-0.05 * (f > 0.0) for f in modes.frequencies_hz)})
    message = shown(rig.replace(rotor=undamped))
    bending = next(f for f in modes.frequencies_hz if f > 0.0)
    assert f"{bending:.4g} Hz" in message
    golden.holds(message)
