"""Effects of what holds the rotor or the housing beside the magnets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from ambid.effects.places import AtPlace, acting_at, mass_or_one, size_of_stiffness
from ambid.effects.traits import DAMPING, RESONANCE, STIFFNESS
from ambid.loop.effect import Effect, EffectParameter, OneProbe, Seen, Trait
from ambid.loop.plant import SENSED, Plant
from ambid.rig import PointMassRotor, Rig

ROUNDED_TOUCH = 0.01
"""Half width of the bend where it begins to touch, as a part of the clearance."""
HUNT_CROSSLEY = 1.5
"""Damping times velocity up to which a body that touches springs back: e = 1 - 2/3 a v of the source."""
SLOWEST_HZ, OF_RATE, OF_FALL = 10.0, 0.1, 0.25
"""From there on a mode of the housing is looked for, or from this part of the sample rate; of a levitator, from this
part of the rate at which it falls."""


def _slowest_hz(rig: Rig) -> float:
    if not isinstance(rig.rotor, PointMassRotor):
        return min(SLOWEST_HZ, OF_RATE * rig.sample_rate)
    return min(
        SLOWEST_HZ,
        OF_RATE * rig.sample_rate,
        OF_FALL * float(np.sqrt(size_of_stiffness(rig) / rig.rotor.mass)) / (2.0 * pi),
    )


@dataclass(frozen=True)
class SealForces(AtPlace):
    """Direct and cross-coupled stiffness and damping at one place of the rotor.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: half-way between the outermost bearings.
    """

    name = "seal_forces"
    physics = "a seal, or another annular gap, pushes the rotor with direct and cross-coupled stiffness and damping"
    equation = "F_x = -k x - k_c y - c x', F_y = -k y + k_c x - c y'"
    signature = "rigid-body band, both planes, and one plane answering the other with opposite signs"
    source = "Childs, Turbomachinery Rotordynamics, 1993, chapter 4"
    at_point_mass = "a point mass has one axis, and no place beside its magnet"
    plural = True
    contains = ("external_damping", "internal_damping", "magnetic_pull")
    across_planes = True

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Direct and cross stiffness [N/m], damping [N s/m]."""
        if isinstance(rig.rotor, PointMassRotor):
            return []
        k = size_of_stiffness(rig)
        return [
            EffectParameter(
                "direct_stiffness", "N/m", 0.02 * k, lower=-float("inf"), meaning="stiffness k against motion"
            ),
            EffectParameter(
                "cross_stiffness",
                "N/m",
                0.02 * k,
                lower=-float("inf"),
                meaning="stiffness k_c from one plane to the other",
            ),
            EffectParameter("damping", "N s/m", 2e-5 * k, meaning="damping c, direct"),
        ]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Its direct stiffness and damping."""
        return {STIFFNESS: values["direct_stiffness"], DAMPING: values["damping"]}

    def attach(self, plant: Plant) -> None:
        """A force at its place in each plane; cross stiffness where there are two."""
        z = self.place(plant.rig)
        planes = np.eye(plant.rotor.planes)
        x = [plant.at(z, plane) for plane in planes]
        v = [plant.at(z, plane, "eta_rate") for plane in planes]
        for k, plane in enumerate(planes):
            force = -plant.port(self.slot("direct_stiffness"), x[k]) - plant.port(self.slot("damping"), v[k])
            if len(planes) == 2:
                force = force + plant.port(self.slot("cross_stiffness"), x[1 - k], scale=-1.0 if k == 0 else 1.0)
            plant.push(z, plane, force)


@dataclass(frozen=True)
class CouplingStiffness(Effect):
    """Stiffness and damping to ground at the drive end.

    Attributes
    ----------
    end : int, optional
        Which end: 0 at z = 0, 1 at the other; default: the other.
    """

    name = "coupling_stiffness"
    physics = "the coupling to the drive holds the end of the shaft with stiffness and damping"
    equation = "F = -k x - c x' at the end, in every plane"
    signature = "rigid-body band, both planes alike, more at the bearing next to the drive; no cross-coupling"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 5"
    contains = ("external_damping",)

    end: int | None = None

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """At either end, since the rig file does not say which is the drive end."""
        return [CouplingStiffness(0), CouplingStiffness(1)] if self.end is None else (self,)

    def positions(self, rig: Rig) -> Sequence[float]:
        """Both ends of the shaft, as far as the rotor is known."""
        return [] if isinstance(rig.rotor, PointMassRotor) else list(rig.rotor.span)

    def why_not(self, rig: Rig) -> str:
        """A rotor without ends."""
        return "a point mass has no drive end" if isinstance(rig.rotor, PointMassRotor) else ""

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Stiffness [N/m] and damping [N s/m] at the drive end."""
        if self.why_not(rig):
            return []
        k = size_of_stiffness(rig)
        return [
            EffectParameter("stiffness", "N/m", 0.01 * k, meaning="stiffness k to ground at the drive end"),
            EffectParameter("damping", "N s/m", 1e-5 * k, meaning="damping c to ground at the drive end"),
        ]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Its stiffness and damping."""
        return {STIFFNESS: values["stiffness"], DAMPING: values["damping"]}

    def attach(self, plant: Plant) -> None:
        """The same in every plane."""
        z = self.positions(plant.rig)[1 if self.end is None else self.end]
        for plane in np.eye(plant.rotor.planes):
            force = plant.port(self.slot("stiffness"), plant.at(z, plane))
            force = force + plant.port(self.slot("damping"), plant.at(z, plane, "eta_rate"))
            plant.push(z, plane, -force)


@dataclass(frozen=True)
class MagneticPull(AtPlace):
    """Negative stiffness at one place, as of a motor or of permanent magnets.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: half-way between the outermost bearings.
    """

    name = "magnetic_pull"
    physics = "a motor, or another magnet beside the bearings, pulls the rotor away from its centre"
    equation = "F = k x at its place, in every plane"
    signature = "rigid-body band, both planes alike, as if K_s were larger between the bearings; no damping"
    source = "Früchtenicht, Jordan, Seinsch, Archiv für Elektrotechnik 65 (1982) 271"
    at_point_mass = "a pull at a plain mass is one of K_s"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Size of the negative stiffness [N/m]."""
        if isinstance(rig.rotor, PointMassRotor):
            return []
        probe = 0.01 * size_of_stiffness(rig)
        return [EffectParameter("stiffness", "N/m", probe, meaning="size k of the negative stiffness")]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """A stiffness below zero."""
        return {STIFFNESS: -values["stiffness"]}

    def attach(self, plant: Plant) -> None:
        """The same in every plane."""
        z = self.place(plant.rig)
        for plane in np.eye(plant.rotor.planes):
            plant.push(z, plane, plant.port(self.slot("stiffness"), plant.at(z, plane)))


@dataclass(frozen=True)
class RotorContact(OneProbe, AtPlace):
    """The rotor touches its touch-down bearing, or another stop all round, at every magnet or at one place.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: at every magnet.
    clearance : float
        That the probe has [m].
    fastest : float
        Velocity of the rotor, the largest [m/s].
    """

    name = "rotor_contact"
    physics = "the rotor touches a touch-down bearing where its displacement exceeds the clearance"
    equation = "F = -k (r - c)+ (1 + a r') u/r, r = |u|, of the displacement u in the plane, or along one axis"
    signature = "odd; nothing below an amplitude, and a spring beyond: only where motion is largest"
    source = (
        "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 13 (touch-down bearings); "
        "Hunt, Crossley, ASME J. Appl. Mech. 42 (1975) 440"
    )
    everywhere = True
    across_planes = True
    size, refitted = "stiffness", (0.01, 1e3)

    clearance: float = 1e-5
    fastest: float = 1e-2

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """At every magnet, half-way between them and at every disk, with clearances within the largest displacement."""
        peak = float(seen.peaks["s"])
        fastest = peak * float(np.sqrt(size_of_stiffness(seen.rig) / mass_or_one(seen.rig)))
        places = self.places(seen.rig) if self.z is None else (self.z,)
        # the first is beyond the largest displacement along an axis; in the plane it is larger
        return [RotorContact(z, share * peak, fastest) for z in places for share in (1.2, 0.9, 0.6, 0.3)]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Stiffness [N/m], clearance [m], and how much stiffer it is against approach [s/m]."""
        gap = min(bearing.air_gap for bearing in rig.bearings)
        return [
            EffectParameter("stiffness", "N/m", size_of_stiffness(rig), meaning="stiffness k where it touches"),
            EffectParameter(
                "clearance", "m", self.clearance, 1e-3 * gap, max(gap, self.clearance), "clearance c all round"
            ),
            EffectParameter(
                "damping",
                "s/m",
                0.1 / self.fastest,
                upper=HUNT_CROSSLEY / self.fastest,
                meaning="damping a: by how much of itself the force grows with the velocity of approach",
            ),
        ]

    def attach(self, plant: Plant) -> None:
        """Rounded where it begins to touch."""
        slots = {name: self.slot(name) for name in ("clearance", "damping")}
        for z, directions in acting_at(plant, self.z).items():
            pairs = [(plant.at(z, own), plant.at(z, own, "eta_rate")) for own in directions.values()]
            constants = {"coordinates": float(len(pairs)), "smoothing": ROUNDED_TOUCH * self.clearance}
            for k, direction in enumerate(directions.values()):
                seen = [signal for pair in (pairs[k], *pairs[:k], *pairs[k + 1 :]) for signal in pair]
                plant.push(
                    z, direction, plant.port(self.slot("stiffness"), plant.block("stop", seen, slots, constants))
                )


@dataclass(frozen=True)
class FoundationResonance(OneProbe):
    """A mode of the housing that carries magnets and sensors.

    Attributes
    ----------
    frequency_hz : float, optional
        That the probe has; default: 100 Hz.
    """

    name = "foundation_resonance"
    physics = "the housing that carries magnets and sensors moves: a mode of the support, the same in each bearing"
    equation = "h'' = -w^2 h - 2 zeta w h' - F/m, w = 2 pi f; magnets and sensors see the rotor less h"
    signature = "a narrow band in y and i_c where no rotor mode lies, all axes"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 10"
    size, refitted = "inverse_mass", (0.1, 100.0)

    frequency_hz: float | None = None

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """A scan over frequency, a tenth of an octave more than its probe is wide."""
        if self.frequency_hz is not None:
            return (self,)
        slowest, fastest = _slowest_hz(seen.rig), 0.2 * seen.rig.sample_rate
        return [FoundationResonance(float(f)) for f in np.geomspace(slowest, fastest, 40)]

    def without_probe(self) -> Effect:
        """The frequency is a parameter."""
        return FoundationResonance()

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Frequency [Hz], damping ratio, compliance as the inverse of the moving mass [1/kg]."""
        return [
            EffectParameter(
                "frequency_hz",
                "Hz",
                self.frequency_hz or 100.0,
                lower=0.1 * _slowest_hz(rig),
                upper=0.5 * rig.sample_rate,
                meaning="frequency f of the housing's mode",
            ),
            EffectParameter("damping", "1", 0.07, upper=0.5, meaning="its damping ratio zeta"),
            EffectParameter("inverse_mass", "1/kg", 1e-3, meaning="its compliance: one over the moving mass m"),
        ]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Its frequency."""
        return {RESONANCE: values["frequency_hz"]}

    def attach(self, plant: Plant) -> None:
        """A housing of its own for each axis."""
        frequency, damping = self.slot("frequency_hz"), self.slot("damping")
        for axis in plant.axes:
            h, scaled_rate = plant.state(f"housing.{axis}"), plant.state(f"housing_rate.{axis}")
            pushed = plant.port(self.slot("inverse_mass"), plant[f"f.{axis}"])
            # scaled_rate = h'/w: h' = w scaled_rate, scaled_rate' = -w h - 2 zeta w scaled_rate - f/(m w)
            rate = plant.port(frequency, scaled_rate, scale=2.0 * pi)
            plant.set_rate(f"housing.{axis}", rate)
            damped = plant.port(damping, scaled_rate, scale=2.0)
            slowed = plant.port(frequency, h + damped, scale=2.0 * pi)
            pushed = plant.port(frequency, pushed, power=-1, scale=1.0 / (2.0 * pi))
            plant.set_rate(f"housing_rate.{axis}", -slowed - pushed)
            seen = {own: part for own, part in plant.on_housing(axis).items() if own.channel in plant.measured}
            if any(own.signal == "a" for own in seen):
                accelerated = plant.port(frequency, -slowed - pushed, scale=2.0 * pi)
            for own, part in seen.items():
                plant.inject(f"{SENSED}{own.channel}", part * (accelerated if own.signal == "a" else h))
            for signal, moved in (("s", h), ("at_sensor", h), ("v", rate)):
                plant.inject(f"{signal}.{axis}", -moved)


EFFECTS = (
    SealForces(),
    CouplingStiffness(),
    MagneticPull(),
    RotorContact(),
    FoundationResonance(),
)
