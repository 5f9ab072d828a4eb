"""The controller's equation, and the machine of the one loop, on lines."""

import numpy as np
import pytest

from ambid.checking.nominal import NominalLoop
from ambid.loop.loop import open_plant
from ambid.loop.response import frequency_response
from ambid.model import Model
from reference.loop_rigs import RIGS


def same_rate(rig):
    return rig.controller.rate(rig.sample_rate) == rig.sample_rate


def lines_of(rig):
    return np.geomspace(1e-3, 0.2, 40) * rig.sample_rate


@pytest.mark.parametrize("name", RIGS)
def test_the_closed_loop_follows_the_controllers_equation(name):
    """To rounding where the controller samples with the record; else what lies above Nyquist's frequency is left."""
    rig = RIGS[name]
    loop, f = NominalLoop(rig), lines_of(rig)
    axes = len(rig.axes)
    closed = loop.closed(f)[:, :, :axes]
    y, i_c = closed[:, :axes], closed[:, axes:]
    of_i_e, of_y = (own[:, None, None] for own in loop.paths(f))
    law = sum(loop.law(f).values())
    left = of_i_e * np.eye(axes) - of_y * (law[:, :, :axes] @ y + law[:, :, axes : 2 * axes] @ i_c) - i_c
    exact = rig.controller.is_digital and same_rate(rig)
    assert np.linalg.norm(left) < (1e-8 if exact else 0.05) * np.linalg.norm(i_c)


@pytest.mark.parametrize("name", RIGS)
def test_the_machine_is_the_plant_behind_the_amplifier(name):
    """In continuous time, low beside the sample rate; the same whatever the controller is."""
    rig = RIGS[name]
    f, axes, tau = np.geomspace(1e-4, 3e-3, 20) * rig.sample_rate, len(rig.axes), rig.amplifier.time_constant
    values = {slot: p.value for p in Model(rig).parameters for slot in p.slots}
    plant = frequency_response(open_plant(rig, ()).closed(values), 2j * np.pi * f)
    expected = plant[:, :axes, :axes] * (1.0 + 2j * np.pi * f * tau)[:, None, None] * (rig.amplifier.resistance or 1.0)
    found = NominalLoop(rig).machine(f)
    assert np.linalg.norm(found - expected) < 0.01 * np.linalg.norm(expected)
