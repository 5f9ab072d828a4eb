"""Rotors taken over from ROSS, on its own bearings: poles, damping and unbalance response as ROSS has them to 0.1 %."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigvals

from ambid.interop import rotor_from_ross
from ambid.rotor import reduced_rotor

ross = pytest.importorskip("ross")

BELOW_RAD_S = 4000.0


def friswell_steel():
    return ross.Material(name="steel", rho=7810.0, E=211e9, G_s=81.2e9)


def two_disks():
    """Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, example 5.9.1."""
    shaft = [ross.ShaftElement(0.25, 0.0, 0.05, material=friswell_steel()) for _ in range(6)]
    disks = [
        ross.DiskElement.from_geometry(n, friswell_steel(), width=0.07, i_d=0.05, o_d=o_d)
        for n, o_d in ((2, 0.28), (4, 0.35))
    ]
    return ross.Rotor(shaft, disks, [ross.BearingElement(n, kxx=1e6, cxx=100.0) for n in (0, 6)])


def overhung():
    """The same shaft with the larger disk beyond the second bearing."""
    shaft = [ross.ShaftElement(0.25, 0.0, 0.05, material=friswell_steel()) for _ in range(6)]
    disk = ross.DiskElement.from_geometry(6, friswell_steel(), width=0.07, i_d=0.05, o_d=0.35)
    return ross.Rotor(shaft, [disk], [ross.BearingElement(n, kxx=1e7, cxx=500.0) for n in (0, 4)])


def tapered():
    """The same book, example 5.9.9: from 25 to 40 mm over 1.5 m, a disk at the middle."""
    ends = np.linspace(0.025, 0.040, 31)
    shaft = [
        ross.ShaftElement(0.05, 0.0, a, 0.0, b, material=friswell_steel())
        for a, b in zip(ends[:-1], ends[1:], strict=True)
    ]
    disk = ross.DiskElement.from_geometry(15, friswell_steel(), width=0.04, i_d=0.0325, o_d=0.25)
    return ross.Rotor(shaft, [disk], [ross.BearingElement(n, kxx=1e7, cxx=1000.0) for n in (0, 30)])


ROTORS = {
    "magnetic bearings of ROSS": lambda: ross.rotor_amb_example(),
    "two disks": two_disks,
    "overhung": overhung,
    "tapered": tapered,
}


@pytest.fixture(scope="module", params=ROTORS)
def pair(request):
    theirs = ROTORS[request.param]()
    taken = rotor_from_ross(theirs, flexible_modes=min(100, 2 * len(theirs.nodes) - 2))
    return theirs, reduced_rotor(taken, np.asarray(theirs.nodes_pos).tolist())


def on_its_bearings(theirs, ours, speed):
    """M = I, and D and K of the taken rotor on the bearings of ROSS at this speed, in coordinates of both planes."""
    n = len(ours.frequencies_rad_s)
    both = np.tile(ours.frequencies_rad_s, 2)
    stiffness = np.diag(both**2)
    damping = np.diag(2.0 * np.tile(ours.damping, 2) * both + ours.mass_damping) + ours.coupling(speed)
    for bearing in theirs.bearing_elements:
        at = place(ours, theirs.nodes_pos[bearing.n])
        stiffness = stiffness + at.T @ np.asarray(bearing.K(speed), float)[:2, :2] @ at
        damping = damping + at.T @ np.asarray(bearing.C(speed), float)[:2, :2] @ at
    assert stiffness.shape == (2 * n, 2 * n)
    return stiffness, damping


def place(ours, z):
    """Displacement of a place in both planes by modal coordinates, (2, 2 modes)."""
    return np.kron(np.eye(2), ours.shape(z))


@pytest.mark.parametrize("speed", [0.0, 300.0])
def test_poles_and_damping_are_those_of_ross(pair, speed):
    theirs, ours = pair
    stiffness, damping = on_its_bearings(theirs, ours, speed)
    size = len(stiffness)
    own = eigvals(np.block([[np.zeros((size, size)), np.eye(size)], [-stiffness, -damping]]))
    of_ross = eigvals(theirs.A(speed, frequency=speed))
    own = own[(own.imag > 100.0) & (np.abs(own) < BELOW_RAD_S)]
    assert len(own) >= 4
    for pole in own:
        nearest = of_ross[np.argmin(np.abs(of_ross - pole))]
        assert abs(nearest - pole) < 1e-3 * abs(pole)
        assert pole.real == pytest.approx(nearest.real, rel=1e-3, abs=1e-9 * abs(pole))


def test_the_unbalance_response_is_that_of_ross(pair):
    theirs, ours = pair
    node, probe, size = theirs.disk_elements[0].n, theirs.bearing_elements[0].n, 1e-4
    speeds = np.linspace(20.0, 900.0, 23)
    answer = theirs.run_unbalance_response(node, size, 0.0, speeds).forced_resp[6 * probe]
    found = []
    for speed in speeds:
        stiffness, damping = on_its_bearings(theirs, ours, speed)
        dynamic = stiffness - speed**2 * np.eye(len(stiffness)) + 1j * speed * damping
        force = place(ours, theirs.nodes_pos[node]).T @ (size * speed**2 * np.array([1.0, -1j]))
        found.append((place(ours, theirs.nodes_pos[probe]) @ np.linalg.solve(dynamic, force))[0])
    assert_allclose(np.abs(found), np.abs(answer), rtol=1e-3)
