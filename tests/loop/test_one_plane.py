"""Bearings that act in one plane: the rotor is modelled there alone, and places need not lie on its nodes."""

import numpy as np
import pytest

from ambid import Model, ModelError, Rig, check
from ambid.effects.places import half_way
from ambid.effects.rotor import RotorBendingMode
from ambid.effects.support import SealForces
from ambid.loop.geometry import rotor_of
from ambid.rig.template import rig_template


def shaft(axes, **more):
    """The shaft of the template, its bearings with these axes."""
    rig = Rig.from_toml(rig_template("pid"))
    numbers = {
        key: tuple(getattr(rig.bearings[0], key)[: len(axes)]) for key in ("force_current", "force_displacement")
    }
    bearings = [b.model_copy(update={"axes": axes, **numbers}) for b in rig.bearings]
    return rig.replace(bearings=tuple(bearings), **more)


def test_poles_are_those_of_one_plane_of_the_whole_rotor():
    one, both = Model(shaft(("zeta",))), Model(shaft(("zeta", "eta")))
    own, all_of_them = one.poles(), both.poles()
    assert one.is_stable
    assert 2 * len(own) == len(all_of_them)
    for pole in own:  # both planes of the whole rotor have each of them
        assert np.sort(np.abs(all_of_them - pole))[1] < 1e-6 * abs(pole)


@pytest.mark.parametrize("tilt", [0.0, 45.0, 90.0])
def test_the_plane_is_that_of_the_axes(tilt):
    level, turned = shaft(("zeta",)), shaft(("zeta",))
    turned = turned.replace(bearings=tuple(b.model_copy(update={"tilt": tilt}) for b in turned.bearings))
    np.testing.assert_allclose(Model(turned).poles(), Model(level).poles(), rtol=1e-9)


def test_check_says_that_one_plane_is_looked_at():
    found = check(shaft(("zeta",), speed=300.0))
    assert found.is_sound
    (said,) = [finding for finding in found.findings if finding.code == "one_plane"]
    assert said.values["speed_rad_s"] == 300.0  # at which gyroscopic moments are missing
    assert not any(finding.code == "one_plane" for finding in check(shaft(("zeta", "eta"))).findings)


SHAFT = """
name = "modes"
sample_rate = 10000
[rotor]
kind = "modes"
frequencies_hz = [0.0, 0.0, 310.0]
damping = [0.0, 0.0, 0.005]
positions = [-0.216, -0.18, 0.18, 0.216]
shapes = [[0.35355, 0.35355, 0.35355, 0.35355], [-0.62354, -0.51962, 0.51962, 0.62354], [0.36, 0.3, 0.28, 0.34]]
flexible_modes = 0
[[bearing]]
name = "A"
position = -0.18
sensor_position = -0.216
bias_current = 3.0
air_gap = 5e-4
force_current = 150.0
force_displacement = 9e5
[[bearing]]
name = "B"
position = 0.18
sensor_position = 0.216
bias_current = 3.0
air_gap = 5e-4
force_current = 150.0
force_displacement = 9e5
[tolerance]
exact = true

[amplifier]
time_constant = 0.0001
[actuator]
time_constant = 0.0002
[controller]
kind = "pid"
implementation = "analog"
proportional = 14000
integral = 300000
derivative = 32
derivative_time_constant = 0.0001
"""


def test_a_seal_stands_where_the_rotor_is_known_with_its_bending_modes_too():
    rig = Rig.from_toml(SHAFT)
    assert half_way(rig) in rotor_of(rig, 1).positions
    model = Model(rig).add(SealForces()).add(RotorBendingMode())
    assert model.poles().size > Model(rig).poles().size


def test_a_place_that_a_further_mode_does_not_reach_is_refused_by_the_effect(golden):
    model = Model(Rig.from_toml(SHAFT)).add(SealForces(0.05))
    with golden.raises(ModelError):
        model.add(RotorBendingMode()).poles()
