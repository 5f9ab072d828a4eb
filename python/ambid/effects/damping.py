"""Effects of what damps the rotor beside the magnets: at rest, turning with it, or rubbing on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambid.effects.hysteresis import drawn_along, gradual
from ambid.effects.places import AtPlace, acting_at, half_way, mass_of, mass_or_one, size_of_stiffness
from ambid.effects.traits import DAMPING
from ambid.loop.effect import Effect, EffectParameter, OneProbe, Seen, Trait
from ambid.loop.geometry import lies_in_one_plane
from ambid.loop.plant import Plant
from ambid.rig import PointMassRotor, Rig

SMALL = 1e-3
"""Friction that is probed, over what K_s does at the air gap."""
OF_STIFFNESS = 2e-5
"""Damping that is probed, over K_s [s]: its force is 1 % of that of K_s at 80 Hz."""


@dataclass(frozen=True)
class ExternalDamping(AtPlace):
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
    everywhere = True

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
        return {DAMPING: values["rate"] * mass_of(rig) if self._is_whole(rig) else values["damping"]}

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


@dataclass(frozen=True)
class InternalDamping(AtPlace):
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
    at_point_mass = "a point mass does not turn"
    across_planes = True

    def why_not(self, rig: Rig) -> str:
        """A rotor at rest, or in one plane."""
        if isinstance(rig.rotor, PointMassRotor):
            return self.at_point_mass
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


@dataclass(frozen=True)
class CoulombFriction(OneProbe, AtPlace):
    """Dry friction at every magnet, or at one place, which sticks like a spring before it slips.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: every magnet.
    width : float
        Of the loop of force over displacement that the probe has [m].
    fastest : float
        Velocity of the rotor, the largest [m/s].
    """

    name = "coulomb_friction"
    physics = "something at rest rubs on the rotor: a force against the motion whose size does not grow with velocity"
    equation = "F = -force h, h' = 2 (u' - |v| |h|^(n-1) h)/width, v = u' h/|h|, of vectors in the plane of motion"
    signature = "odd; damps small motion more than large, and holds the smallest as a spring"
    source = "Dahl, Aerospace Corporation TOR-158 (1968); Wen, ASCE J. Eng. Mech. 102 (1976) 249"
    everywhere = True
    across_planes = True
    # of a slider on a spring 0.1 %, of a smooth step over the velocity 0.2 %; of Dahl's law in two planes up to 3 %
    usual_error, formula_error = 2e-3, 0.03
    size, refitted = "force", (0.01, 1e3)

    width: float = 3e-6
    fastest: float = 1e-2

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """At each place, with loops narrow and wide against the motion."""
        rig, peak = seen.rig, float(seen.peaks["s"])
        places = self.places(rig) if self.z is None else (self.z,)
        fastest = peak * float(np.sqrt(size_of_stiffness(rig) / mass_or_one(rig)))
        return [CoulombFriction(z, share * peak, fastest) for z in places for share in (0.03, 0.3)]

    def places(self, rig: Rig) -> Sequence[float | None]:
        """At every magnet, half-way between them, and at both ends."""
        return (None,) if isinstance(rig.rotor, PointMassRotor) else (None, half_way(rig), *rig.rotor.span)

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Force that it slips at [N], one over the width of its loop [1/m], and how gradually it begins to slip."""
        gap = float(np.mean([bearing.air_gap for bearing in rig.bearings]))
        return [
            EffectParameter("force", "N", SMALL * size_of_stiffness(rig) * gap, meaning="force at which it slips"),
            EffectParameter(
                "inverse_width",
                "1/m",
                1.0 / self.width,
                lower=1e2,
                upper=1e10,
                meaning="one over the width of the loop: twice the displacement by which it sticks",
            ),
            gradual(),
        ]

    def attach(self, plant: Plant) -> None:
        """A state for each axis or plane that is drawn along until it slips; those of one place slip together."""
        for z, directions in acting_at(plant, self.z).items():
            rates = {name: plant.at(z, own, "eta_rate") for name, own in directions.items()}
            found = drawn_along(plant, self, rates, self.fastest)
            for direction, (share, _) in zip(directions.values(), found, strict=True):
                plant.push(z, direction, -plant.port(self.slot("force"), share))


EFFECTS = (
    ExternalDamping(),
    InternalDamping(),
    CoulombFriction(),
)
