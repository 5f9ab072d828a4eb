"""Rotors taken over from ROSS, on its own bearings: poles, damping and unbalance response as ROSS has them to 0.1 %.

ROSS's own example on magnetic bearings and three of Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines,
2010. What ROSS 2.3.0 holds and finds was written by `reference/ross_rotors.py`.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import eigvals

from ambid.interop import rotor_from_ross
from ambid.rotor import reduced_rotor
from places import TESTS
from validated import relative

with np.load(TESTS / "reference" / "ross_taken.npz") as stored:
    ROSS = {key: stored[key] for key in stored.files}
SPEEDS = ROSS["speeds"]
"""At which the bearings are known [rad/s]: at rest, of the poles, of the unbalance response."""
BELOW_PER_S = 4000.0
UNBALANCE = 1e-4


@dataclass(frozen=True)
class BearingOfRoss:
    """A bearing element at the speeds that are stored."""

    n: int
    matrices: dict
    tag: str = ""

    def M(self, speed):
        """Mass matrix."""
        return self.of("M", speed)

    def K(self, speed):
        """Stiffness matrix."""
        return self.of("K", speed)

    def C(self, speed):
        """Damping matrix."""
        return self.of("C", speed)

    def of(self, key, speed):
        """One of these, both displacements."""
        return self.matrices[key][np.argmin(np.abs(SPEEDS - speed))]


class MagneticBearingOfRoss(BearingOfRoss):
    """A magnetic one: its name gives its kind."""


class RotorOfRoss:
    """What of a ross.Rotor is read, as it was stored."""

    def __init__(self, name):
        self.own = {key.partition("/")[2]: value for key, value in ROSS.items() if key.startswith(f"{name}/")}
        self.nodes_pos = self.own["z"]
        self.bearing_elements = [
            (MagneticBearingOfRoss if magnetic else BearingOfRoss)(
                int(node), {key: self.own[f"bearing_{key}"][k] for key in "MKC"}
            )
            for k, (node, magnetic) in enumerate(zip(self.own["bearing_nodes"], self.own["magnetic"], strict=True))
        ]

    def M(self, frequency):
        """Mass matrix, with the bearings'."""
        return self.own["M"]

    def K(self, frequency):
        """Stiffness matrix, with the bearings'."""
        return self.own["K"]

    def C(self, frequency):
        """Damping matrix, with the bearings'."""
        return self.own["C"]

    def G(self):
        """Gyroscopic matrix."""
        return self.own["G"]


NAMES = ["magnetic", "two disks", "overhung", "tapered"]


@pytest.fixture(scope="module", params=NAMES)
def pair(request):
    theirs = RotorOfRoss(request.param)
    taken = rotor_from_ross(theirs, flexible_modes=min(100, 2 * len(theirs.nodes_pos) - 2))
    assert len(taken.support) + len(taken.findings) == len(theirs.bearing_elements)
    return theirs, reduced_rotor(taken, theirs.nodes_pos.tolist())


def on_its_bearings(theirs, ours, speed):
    """M = I, and D and K of the taken rotor on the bearings of ROSS at this speed, in coordinates of both planes."""
    n = len(ours.frequencies_rad_s)
    both = np.tile(ours.frequencies_rad_s, 2)
    stiffness = np.diag(both**2)
    damping = np.diag(2.0 * np.tile(ours.damping, 2) * both + ours.mass_damping) + ours.coupling(speed)
    for bearing in theirs.bearing_elements:
        at = place(ours, theirs.nodes_pos[bearing.n])
        stiffness = stiffness + at.T @ bearing.K(speed) @ at
        damping = damping + at.T @ bearing.C(speed) @ at
    assert stiffness.shape == (2 * n, 2 * n)
    return stiffness, damping


def place(ours, z):
    """Displacement of a place in both planes by modal coordinates, (2, 2 modes)."""
    return np.kron(np.eye(2), ours.shape(z))


@pytest.mark.parametrize("k", [0, 1])
def test_poles_and_damping_are_those_of_ross(pair, k, validated):
    theirs, ours = pair
    stiffness, damping = on_its_bearings(theirs, ours, SPEEDS[1 + k])
    size = len(stiffness)
    own = eigvals(np.block([[np.zeros((size, size)), np.eye(size)], [-stiffness, -damping]]))
    of_ross = theirs.own[f"poles_{k}"]
    own = own[(own.imag > 100.0) & (np.abs(own) < BELOW_PER_S)]
    assert len(own) >= 4
    nearest = np.array([of_ross[np.argmin(np.abs(of_ross - pole))] for pole in own])
    validated(
        "Poles of rotors on bearings, at rest and turning: relative error",
        "ROSS 2.3.0: magnetic bearings, and three rotors of Friswell et al., Dynamics of Rotating Machines, 2010",
        relative(own, nearest),
        1e-3,
    )
    validated(
        "Damping of these poles: relative error of their real parts",
        "ROSS 2.3.0",
        np.abs(own.real - nearest.real) / np.maximum(np.abs(nearest.real), 1e-6 * np.abs(own)),
        1e-3,
    )


def test_the_unbalance_response_is_that_of_ross(pair, validated):
    theirs, ours = pair
    heavy = theirs.nodes_pos[theirs.own["unbalance_node"]]
    probe = theirs.nodes_pos[theirs.bearing_elements[0].n]
    found = []
    for speed in SPEEDS[3:]:
        stiffness, damping = on_its_bearings(theirs, ours, speed)
        dynamic = stiffness - speed**2 * np.eye(len(stiffness)) + 1j * speed * damping
        force = place(ours, heavy).T @ (UNBALANCE * speed**2 * np.array([1.0, -1j]))
        found.append((place(ours, probe) @ np.linalg.solve(dynamic, force))[0])
    validated(
        "Unbalance response: relative error of the amplitude",
        "ROSS 2.3.0",
        relative(np.abs(found), np.abs(theirs.own["response"])),
        1e-3,
    )


@pytest.mark.parametrize("name", NAMES)
def test_what_is_stored_is_what_ross_has(name):
    pytest.importorskip("ross")
    reference = pytest.importorskip("reference.ross_rotors")
    live, stored = reference.ROTORS[name](), RotorOfRoss(name)
    again = reference.taken(name, live)
    for key in ("M", "K", "C", "G", "z", "bearing_K", "bearing_C"):
        np.testing.assert_allclose(again[f"{name}/{key}"], stored.own[key], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(again[f"{name}/response"], stored.own["response"], rtol=1e-6)
    one, other = (rotor_from_ross(rotor, flexible_modes=4) for rotor in (live, stored))
    assert [own.code for own in one.findings] == [own.code for own in other.findings]
    assert one.support == other.support
    one, other = (reduced_rotor(own, stored.nodes_pos.tolist()) for own in (one, other))
    np.testing.assert_allclose(one.frequencies_rad_s, other.frequencies_rad_s, rtol=1e-9, atol=1e-3)
