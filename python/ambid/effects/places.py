"""Where along the shaft something may act that the rig file does not place, and how strongly it is probed."""

from __future__ import annotations

import numpy as np

from ambid.loop.geometry import rotor_of, why_unknown
from ambid.rig import FiniteElementRotor, Rig
from ambid.rotor import further_modes

MORE_MODES = 2
"""Bending modes beyond those of the model that may join it beside what acts there."""


def size_of_stiffness(rig: Rig) -> float:
    """Mean size of K_s [N/m], by which forces to ground are probed."""
    return float(np.mean([abs(k) for b in rig.bearings for k in b.force_displacement]))


def half_way(rig: Rig) -> float:
    """Half-way between the outermost bearings, or the place nearest to it where the rotor is known [m].

    Known with the bending modes, too, that the model leaves out.
    """
    ends = [b.position for b in rig.bearings]
    middle = 0.5 * (min(ends) + max(ends))
    if not why_unknown(rig, [middle], further_modes(rig.rotor, MORE_MODES)):
        return middle
    return float(min(rotor_of(rig).positions, key=lambda z: round(abs(z - middle), 9)))


def likely_places(rig: Rig) -> list[float]:
    """Half-way between the bearings, and every disk [m]."""
    disks = [disk.position for disk in rig.rotor.disk] if isinstance(rig.rotor, FiniteElementRotor) else []
    return sorted({round(half_way(rig), 9), *disks})
