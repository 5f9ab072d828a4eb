"""Where along the shaft something may act that the rig file does not place."""

from __future__ import annotations

from ambid.rig import FiniteElementRotor, Rig


def half_way(rig: Rig) -> float:
    """Half-way between the outermost bearings [m]."""
    ends = [b.position for b in rig.bearings]
    return 0.5 * (min(ends) + max(ends))


def likely_places(rig: Rig) -> list[float]:
    """Half-way between the bearings, and every disk [m]."""
    disks = [disk.position for disk in rig.rotor.disk] if isinstance(rig.rotor, FiniteElementRotor) else []
    return sorted({round(half_way(rig), 9), *disks})
