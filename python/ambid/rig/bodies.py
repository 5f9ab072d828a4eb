"""What the inertias of any body keep to: about its axis it has at most twice what it has across."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic_core import InitErrorDetails

from ambid.rig.fields import plain, problem

__all__ = ["polar_over_transverse", "too_polar", "too_polar_disk"]

MOST_POLAR = 2.02
"""Polar inertia of a body over its transverse one: 2 of a thin disk, and what rounding adds."""


def too_polar_disk(transverse: float, polar: float) -> list[InitErrorDetails]:
    """Problem of a disk with these inertias [kg m^2]; none where a body has them."""
    if polar <= MOST_POLAR * transverse:
        return []
    text = (
        f"expected at most {plain(2.0 * transverse)} kg m^2, twice transverse_inertia: no body has more, and a thin "
        "disk has as much; are the two exchanged, or is one in another unit?"
    )
    return [problem(text, polar, "polar_inertia")]


def polar_over_transverse(
    M: Sequence[Sequence[float]], G: Sequence[Sequence[float]], node_positions: Sequence[float]
) -> float:
    """Polar inertia of a whole rotor by G over its transverse one about the centre of mass by M."""
    mass, z = np.array(M), np.array(node_positions)
    ones, none = np.ones_like(z), np.zeros_like(z)
    shift = np.column_stack([ones, none, none, none]).ravel()
    centre = float(shift @ mass @ np.column_stack([z, none, none, ones]).ravel() / (shift @ mass @ shift))
    in_x = np.column_stack([z - centre, none, none, ones]).ravel()
    in_y = np.column_stack([none, z - centre, -ones, none]).ravel()
    return float(abs(in_y @ np.array(G) @ in_x) / (in_x @ mass @ in_x))


def too_polar(ratio: float, value: Any, key: str) -> list[InitErrorDetails]:
    """Problem of a rotor that as a rigid body has a larger polar inertia than any body; none where it has not."""
    if ratio <= MOST_POLAR:
        return []
    text = (
        f"its polar inertia is {plain(ratio)} times the transverse one of the whole rotor, expected at most 2: no body "
        "has more; is it multiplied by the speed already? Here speed [rad/s] multiplies it."
    )
    return [problem(text, value, key)]
