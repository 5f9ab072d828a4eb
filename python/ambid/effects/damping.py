"""Effects of what damps the rotor beside the magnets: at rest, turning with it, or rubbing on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambid.effects.places import half_way, likely_places, size_of_stiffness
from ambid.effects.traits import DAMPING
from ambid.loop.effect import Effect, EffectParameter, Seen, Trait
from ambid.loop.geometry import lies_in_one_plane, rotor_of
from ambid.loop.plant import Plant
from ambid.rig import PointMassRotor, Rig

OF_STIFFNESS = 2e-5
"""Damping that is probed, over K_s [s]: its force is 1 % of that of K_s at 80 Hz."""


@dataclass(frozen=True)
class ExternalDamping(Effect):
    """Viscous damping to ground: of the whole rotor in proportion to its mass, or at one place.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: the whole rotor.
    """

    name = "external_damping"
    physics = "something at rest, such as air, a fluid or a guide, damps the rotor in proportion to its velocity"
    equation = "F = -a M q' of the whole rotor, or F = -c u' at one place, in every plane"
    signature = "rigid-body motion and bending peaks damped more, in both planes alike; no stiffness, no cross-coupling"
    source = "Genta, Dynamics of Rotating Systems, 2005, section 2.4 (nonrotating damping)"
    fine = ("z",)

    z: float | None = None

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """The whole rotor; half-way between the bearings, and every disk."""
        if self.z is not None or isinstance(seen.rig.rotor, PointMassRotor):
            return (self,)
        return [self, *(ExternalDamping(z) for z in likely_places(seen.rig))]

    def positions(self, rig: Rig) -> Sequence[float]:
        """Its place, if it has one."""
        return [] if self.z is None or isinstance(rig.rotor, PointMassRotor) else [self.z]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Damping [N s/m] at a place or of a plain mass; of a whole rotor over its mass, the rate [1/s]."""
        if self._is_whole(rig):
            return [
                EffectParameter("rate", "1/s", 1.0, meaning="a: damping to ground of the whole rotor over its mass")
            ]
        probe = OF_STIFFNESS * size_of_stiffness(rig)
        return [EffectParameter("damping", "N s/m", probe, meaning="damping c to ground")]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Its damping, of a whole rotor for a motion without tilt."""
        return {DAMPING: values["rate"] * _mass(rig) if self._is_whole(rig) else values["damping"]}

    def attach(self, plant: Plant) -> None:
        """A force on every mode, or at its place in each plane."""
        if self._is_whole(plant.rig):
            for k in range(plant.coordinates):
                plant.inject(f"modal_force.{k}", -plant.port(self.slot("rate"), plant[f"eta_rate.{k}"]))
            return
        z = 0.0 if self.z is None else self.z
        for plane in np.eye(plant.rotor.planes):
            plant.push(z, plane, -plant.port(self.slot("damping"), plant.at(z, plane, "eta_rate")))

    def _is_whole(self, rig: Rig) -> bool:
        return self.z is None and not isinstance(rig.rotor, PointMassRotor)


def _mass(rig: Rig) -> float:
    """Mass of a rotor [kg] by its rigid modes; NaN where they hold no translation."""
    rotor = rotor_of(rig)
    rigid = rotor.shapes[:, rotor.frequencies_rad_s == 0.0]
    if not rigid.size:
        return float("nan")
    translation = np.linalg.lstsq(rigid, np.ones(len(rigid)), rcond=None)[0]
    return float(translation @ translation)


@dataclass(frozen=True)
class InternalDamping(Effect):
    """Damping that turns with the rotor, at one place.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: half-way between the outermost bearings.
    """

    name = "internal_damping"
    physics = "something that turns with the rotor, such as a fit or a coupling, damps its motion as the rotor sees it"
    equation = "F_x = -c (x' + Omega y), F_y = -c (y' - Omega x)"
    signature = "backward whirl damped, forward whirl driven above its critical speed; one plane answers the other"
    source = "Genta, Dynamics of Rotating Systems, 2005, section 2.4 (rotating damping)"
    across_planes = True
    fine = ("z",)

    z: float | None = None

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Half-way between the bearings, and at every disk."""
        return [InternalDamping(z) for z in likely_places(seen.rig)] if self.z is None else (self,)

    def place(self, rig: Rig) -> float:
        """Where it acts [m]; by default half-way between the outermost bearings."""
        return half_way(rig) if self.z is None else self.z

    def positions(self, rig: Rig) -> Sequence[float]:
        """Its place."""
        return [] if isinstance(rig.rotor, PointMassRotor) else [self.place(rig)]

    def why_not(self, rig: Rig) -> str:
        """A rotor at rest, or in one plane."""
        if isinstance(rig.rotor, PointMassRotor):
            return "a point mass does not turn"
        if rig.speed <= 0.0:
            return "the rotor does not turn (speed = 0), and at rest it is external_damping"
        if lies_in_one_plane(rig):
            return "all axes lie in one plane, and its force across that plane is not seen"
        return super().why_not(rig)

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Damping [N s/m]."""
        if isinstance(rig.rotor, PointMassRotor) or rig.speed <= 0.0 or lies_in_one_plane(rig):
            return []
        probe = OF_STIFFNESS * size_of_stiffness(rig)
        return [EffectParameter("damping", "N s/m", probe, meaning="damping c that turns with the rotor")]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Its damping."""
        return {DAMPING: values["damping"]}

    def attach(self, plant: Plant) -> None:
        """A force at its place against the velocity that somebody on the rotor sees."""
        z, speed, slot = self.place(plant.rig), plant.rig.speed, self.slot("damping")
        x, y = np.eye(2)
        for plane, other, turn in ((x, y, speed), (y, x, -speed)):
            seen = plant.at(z, plane, "eta_rate") + turn * plant.at(z, other)
            plant.push(z, plane, -plant.port(slot, seen))


EFFECTS = (
    ExternalDamping(),
    InternalDamping(),
)
