"""Where along the shaft something may act that the rig file does not place, and how strongly it is probed."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from ambid.arrays import FloatArray
from ambid.loop.effect import Effect, Seen
from ambid.loop.geometry import rotor_of, why_unknown
from ambid.loop.plant import Plant
from ambid.rig import Bearing, FiniteElementRotor, PointMassRotor, Rig
from ambid.rotor import ReducedRotor, further_modes

REACH = 5e-3
"""Distance [m] to which the shapes about a place are looked at that may be elsewhere: ten times its usual tolerance."""


def size_of_stiffness(rig: Rig) -> float:
    """Mean size of K_s [N/m], by which forces to ground are probed."""
    return float(np.mean([abs(k) for b in rig.bearings for k in b.force_displacement]))


def mass_of(rig: Rig) -> float:
    """Mass of a rotor [kg] by its rigid modes; NaN where they hold no translation."""
    rotor = rotor_of(rig)
    rigid = rotor.shapes[:, rotor.frequencies_rad_s == 0.0]
    if not rigid.size:
        return float("nan")
    translation = np.linalg.lstsq(rigid, np.ones(len(rigid)), rcond=None)[0]
    return float(translation @ translation)


def mass_or_one(rig: Rig) -> float:
    """Mass of the rotor [kg]; 1 kg where its modes do not give it."""
    mass = mass_of(rig)
    return mass if mass > 0.0 else 1.0


def half_way(rig: Rig) -> float:
    """Half-way between the outermost bearings, or the place nearest to it where the rotor is known [m].

    Known with the bending modes, too, that the model leaves out.
    """
    ends = [b.position for b in rig.bearings]
    middle = 0.5 * (min(ends) + max(ends))
    # bending modes beyond those of the model that may join it beside what acts there
    if not why_unknown(rig, [middle], further_modes(rig.rotor, 2)):
        return middle
    return float(min(rotor_of(rig).positions, key=lambda z: round(abs(z - middle), 9)))


def likely_places(rig: Rig) -> list[float]:
    """Half-way between the bearings, and every disk [m]."""
    disks = [disk.position for disk in rig.rotor.disk] if isinstance(rig.rotor, FiniteElementRotor) else []
    return sorted({round(half_way(rig), 9), *disks})


def about(rig: Rig, places: Iterable[float]) -> list[float]:
    """Four places about each place, evenly apart, as far as the shaft reaches [m]; none of a point mass."""
    if isinstance(rig.rotor, PointMassRotor):
        return []
    low, high = rig.rotor.span
    ends = [(max(low, z - REACH), min(high, z + REACH)) for z in places]
    return [float(z) for first, last in ends for z in np.linspace(first, last, 5)[[0, 1, 3, 4]]]


def of_two_axes(rig: Rig) -> list[Bearing]:
    """Bearings that act in two directions."""
    return [bearing for bearing in rig.bearings if len(bearing.axes) == 2]


def moved_along(
    plant: Plant, places: Sequence[float], positions: Sequence[float]
) -> Iterator[tuple[Bearing, str, list[FloatArray]]]:
    """Bearing, axis, and what the first three powers of a distance from its place bring to the shapes there.

    Parameters
    ----------
    places : sequence of float
        Of each bearing [m].
    positions : sequence of float
        Four about each, see `about`.
    """
    directions = dict(zip(plant.axes, plant.directions, strict=True))
    for k, (bearing, z) in enumerate(zip(plant.rig.bearings, places, strict=True)):
        powers = _powers(plant.rotor, z, tuple(positions[4 * k : 4 * k + 4]))
        for axis in bearing.axis_names:
            yield bearing, axis, [np.outer(directions[axis], own).ravel() for own in powers]


@lru_cache(maxsize=64)
def _powers(rotor: ReducedRotor, z: float, near: tuple[float, ...]) -> list[FloatArray]:
    """What the first three powers of a distance from z bring to the shape of each mode there, by the shapes nearby."""
    distance = (np.array(near) - z) / REACH
    others = np.array([rotor.shape(at) for at in near]) - rotor.shape(z)
    found = np.linalg.lstsq(distance[:, None] ** [1, 2, 3], others)[0]
    return [own / REACH**power for power, own in enumerate(found, 1)]


def acting_at(plant: Plant, z: float | None) -> dict[float, dict[str, FloatArray]]:
    """Directions by name in which something acts on the rotor, by place: in every plane at z, or at every magnet."""
    if z is not None:
        return {z: {f"plane.{k}": plane for k, plane in enumerate(np.eye(plant.rotor.planes))}}
    own = dict(zip(plant.axes, plant.directions, strict=True))
    return {b.position: {axis: own[axis] for axis in b.axis_names} for b in plant.rig.bearings}


@dataclass(frozen=True)
class AtPlace(Effect):
    """An effect at one place of the shaft, which a diagnosis moves to where J is least.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: half-way between the outermost bearings, or everywhere.
    everywhere : bool
        Whether without a place it acts along the whole rotor, or at every magnet.
    at_point_mass : str
        Why it is not tried on a plain mass; empty where it is.
    """

    fine = ("z",)
    everywhere: ClassVar[bool] = False
    at_point_mass: ClassVar[str] = ""

    z: float | None = None

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """At its place, or at each of those that it may have."""
        return (self,) if self.z is not None else [replace(self, z=z) for z in self.places(seen.rig)]

    def places(self, rig: Rig) -> Sequence[float | None]:
        """Everywhere, if it can be; half-way between the bearings, and at every disk."""
        if isinstance(rig.rotor, PointMassRotor):
            return (None,)
        return [*([None] if self.everywhere else []), *likely_places(rig)]

    def place(self, rig: Rig) -> float:
        """Where it acts [m]; by default half-way between the outermost bearings."""
        return half_way(rig) if self.z is None else self.z

    def positions(self, rig: Rig) -> Sequence[float]:
        """Its place, if it has one."""
        is_placed = self.z is not None or not self.everywhere
        return [self.place(rig)] if is_placed and not isinstance(rig.rotor, PointMassRotor) else []

    def why_not(self, rig: Rig) -> str:
        """A plain mass, or a rotor that is not known at its place."""
        return (
            self.at_point_mass if self.at_point_mass and isinstance(rig.rotor, PointMassRotor) else super().why_not(rig)
        )
