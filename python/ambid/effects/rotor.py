"""Effects of the rotor itself: how it bends, its inertia, its unbalance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from ambid.arrays import FloatArray
from ambid.effects.places import likely_places
from ambid.effects.traits import RESONANCE
from ambid.effects.waves import Wave, is_synchronous
from ambid.errors import RigError
from ambid.loop.assembly import combine
from ambid.loop.effect import Effect, EffectParameter, Seen, Trait
from ambid.loop.geometry import lies_in_one_plane, rotor_of
from ambid.loop.plant import Plant
from ambid.rig import PointMassRotor, Rig
from ambid.rotor import further_modes

BELOW = 0.4
"""Part of the sample rate below which a bending mode is looked for."""
FAR_OFF = (-0.1, -0.03, 0.03, 0.1)
"""Relative shifts of a squared frequency, by more than the width of most peaks."""


@dataclass(frozen=True)
class RotorBendingMode(Effect):
    """Bending modes that the base model left out.

    Attributes
    ----------
    participation : float
        That the probe has, of the one computed.
    """

    name = "rotor_bending_mode"
    physics = "the rotor bends in modes that the base model left out"
    equation = "eta'' = p force - w^2 eta - 2 zeta w eta', w = 2 pi f, of each further mode"
    signature = "narrow peaks near the free-free bending frequencies, in y and i_c"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapters 5 and 6"

    participation: float = 1.0

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Modes that take part as computed, and weaker ones, which the loop moves less."""
        return [RotorBendingMode(share) for share in (1.0, 0.1, 0.01)]

    def without_probe(self) -> Effect:
        """The participation is a parameter."""
        return RotorBendingMode()

    def flexible_modes(self, rig: Rig) -> int:
        """How many further modes lie well below half the sample rate; two at the most."""
        more = further_modes(rig.rotor, 2)
        found = rotor_of(rig, more).frequencies_rad_s[-more:] if more else ()
        return sum(w < 2.0 * pi * BELOW * rig.sample_rate for w in found)

    def why_not(self, rig: Rig) -> str:
        """A rotor without further modes, or with such as no record of this sample rate shows."""
        if isinstance(rig.rotor, PointMassRotor):
            return "a point mass does not bend"
        if not further_modes(rig.rotor, 1):
            return "the rotor's data hold no bending modes beyond those that its model keeps"
        try:
            high = not self.flexible_modes(rig)
        except RigError as error:
            return str(error)
        return f"the bending modes left out lie above {BELOW:g} of the sample rate" if high else ""

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Frequency [Hz], damping ratio and participation of each further mode."""
        if self.why_not(rig):
            return []
        more = self.flexible_modes(rig)
        rotor = rotor_of(rig, more)
        given = getattr(rig.rotor, "modal_damping", 0.0)
        likely = given if isinstance(given, float) else next(iter(given[::-1]), 0.0)
        parameters = []
        further = zip(rotor.frequencies_rad_s[-more:] / (2.0 * pi), rotor.damping[-more:], strict=True)
        for k, (frequency, listed) in enumerate(further, start=1):
            damping = next((ratio for ratio in (float(listed), likely) if ratio > 0.0), 0.003)
            parameters += [
                EffectParameter(
                    f"frequency_{k}_hz",
                    "Hz",
                    float(frequency),
                    lower=0.7 * frequency,
                    upper=1.4 * frequency,
                    meaning=f"free-free frequency f of further mode {k}",
                ),
                EffectParameter(
                    f"damping_{k}", "1", damping, lower=1e-5, upper=0.3, meaning=f"damping ratio zeta of mode {k}"
                ),
                EffectParameter(
                    f"participation_{k}",
                    "1",
                    self.participation,
                    upper=4.0,
                    meaning=f"participation p of mode {k}: 1 as computed, 0 for none",
                ),
            ]
        return parameters

    def probes(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Each further mode as computed, without the others: mode in minus mode out."""
        own = self.parameters(rig)
        alone = {p.name: p.probe for p in own if not p.name.startswith("participation")}
        return [
            alone | {p.name: p.probe * p.name.endswith(f"_{k}") for p in own if p.name.startswith("participation")}
            for k in range(1, len(own) // 3 + 1)
        ]

    def amplitudes(self, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        """Of each mode, nothing or any share."""
        count = len(self.probes(rig))
        return np.zeros(count), np.full(count, np.inf)

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """As computed, with the participation that the residual calls for."""
        start = {p.name: p.probe for p in self.parameters(rig)}
        for k, amplitude in enumerate(amplitudes, start=1):
            start[f"participation_{k}"] = float(np.clip(amplitude * self.participation, 1e-4, 1.0))
        return start

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """The frequency of the first of them."""
        return {RESONANCE: values["frequency_1_hz"]}

    def attach(self, plant: Plant) -> None:
        """A participation of 1 is a mode whose shape is right at magnets and sensors.

        Gyroscopic moments are among the forces, so that a mode that takes no part is none.
        """
        more = self.flexible_modes(plant.rig)
        n = len(plant.rotor.frequencies_rad_s)
        rates = [plant[f"eta_rate.{k}"] for k in range(plant.coordinates)]
        coupling = plant.rotor.coupling(plant.rig.speed)
        for j in range(more):
            frequency, damping = self.slot(f"frequency_{j + 1}_hz"), self.slot(f"damping_{j + 1}")
            for plane in range(plant.rotor.planes):
                k = plane * n + n - more + j
                turning = combine(-coupling[k], rates)
                force = plant.raw(f"modal_force.{k}") + turning
                taking_part = plant.port(self.slot(f"participation_{j + 1}"), force) - force
                w_eta = plant.port(frequency, plant[f"eta.{k}"], scale=2.0 * pi)
                damped = plant.port(damping, plant[f"eta_rate.{k}"], scale=2.0)
                held = plant.port(frequency, w_eta + damped, scale=2.0 * pi)
                plant.inject(f"modal_force.{k}", taking_part - held)


@dataclass(frozen=True)
class BendingModeShift(Effect):
    """Frequency and damping of kept modes differ from the model's."""

    name = "bending_mode_shift"
    physics = "a kept bending mode has another frequency or damping than the model says"
    equation = "eta'' + 2 (zeta + z) w eta' + (1 + d) w^2 eta = force, of each kept bending mode"
    signature = "a narrow peak at a kept bending frequency that changes sign across it"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 5"

    def why_not(self, rig: Rig) -> str:
        """A model that keeps no bending modes."""
        if isinstance(rig.rotor, PointMassRotor):
            return "a point mass does not bend"
        return "" if rig.rotor.bending_modes else "the model keeps no bending modes"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative shift of the squared frequency, and of the damping [times the critical], of each kept mode."""
        parameters = []
        for k in range(1, rig.rotor.bending_modes + 1):
            parameters += [
                EffectParameter(
                    f"squared_frequency_{k}",
                    "1",
                    1e-3,
                    lower=-0.6,
                    upper=0.6,
                    meaning=f"relative shift d of the squared frequency of kept mode {k}",
                ),
                EffectParameter(
                    f"damping_{k}",
                    "1",
                    3e-4,
                    lower=-0.02,
                    upper=0.3,
                    meaning=f"shift z of the damping ratio of kept mode {k}",
                ),
            ]
        return parameters

    def far_starts(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Each mode higher and lower by more than the width of its peak, of which a score sees nothing."""
        own = self.parameters(rig)
        shifted = [p.name for p in own if p.name.startswith("squared_frequency")]
        return [{p.name: by if p.name == name else 0.0 for p in own} for name in shifted for by in FAR_OFF]

    def attach(self, plant: Plant) -> None:
        """Stiffness and damping beside those of the mode."""
        for k, mode, w in kept_modes(plant):
            stiffer = plant.port(self.slot(f"squared_frequency_{mode}"), plant[f"eta.{k}"], scale=w**2)
            damped = plant.port(self.slot(f"damping_{mode}"), plant[f"eta_rate.{k}"], scale=2.0 * w)
            plant.inject(f"modal_force.{k}", -stiffer - damped)


def kept_modes(plant: Plant) -> Iterator[tuple[int, int, float]]:
    """Of every kept bending mode in every plane its coordinate, its number from 1 on, and its frequency [rad/s]."""
    n, first = len(plant.rotor.frequencies_rad_s), plant.rotor.rigid_modes
    for j in range(plant.rig.rotor.bending_modes):
        for plane in range(plant.rotor.planes):
            yield plane * n + first + j, j + 1, float(plant.rotor.frequencies_rad_s[first + j])


@dataclass(frozen=True)
class RotorInertiaError(Effect):
    """Mass or transverse inertia differ from the model's."""

    name = "rotor_inertia_error"
    physics = "the mass or the transverse inertia of the rotor differs from the model's"
    equation = "(1 + d) eta'' = force, of translation and of rotation"
    signature = "rigid-body motion at high frequency too large or too small, at every amplitude"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 3"

    def why_not(self, rig: Rig) -> str:
        """A rotor whose rigid modes do not distinguish its mass from its inertia."""
        if isinstance(rig.rotor, PointMassRotor):
            return "an error of the mass alone is one of K_i and K_s"
        given = rotor_of(rig).rigid_modes
        return "" if given == 2 else f"the rotor has {given} modes of 0 Hz, and not translation and rotation"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative errors of transverse inertia and mass; that of the mass shows against the bending modes alone.

        Without bending modes a gain common to all modes is one of K_i and K_s.
        """
        if self.why_not(rig):
            return []
        meanings = {"inertia": "relative error d of the transverse inertia", "mass": "relative error d of the mass"}
        names = ["inertia", "mass"] if rig.rotor.bending_modes else ["inertia"]
        return [EffectParameter(name, "1", 0.01, lower=-0.5, upper=1.0, meaning=meanings[name]) for name in names]

    def attach(self, plant: Plant) -> None:
        """The force of rotation and translation is divided by 1 + d."""
        motions = plant.rotor.rigid_motions()
        divide_forces(plant, {self.slot(p.name): motions[p.name] for p in self.parameters(plant.rig)})


def divide_forces(plant: Plant, motions: Mapping[str, FloatArray]) -> None:
    """Divide the force of rigid motions, by slot, in every plane by 1 + what fills the slot."""
    n = len(plant.rotor.frequencies_rad_s)
    for plane in range(plant.rotor.planes):
        for slot, motion in motions.items():
            forces = [f"modal_force.{plane * n + k}" for k in range(len(motion))]
            heavier = plant.port(slot, combine(motion, [plant[force] for force in forces]))
            for force, share in zip(forces, motion, strict=True):
                plant.inject(force, -share * heavier)


@dataclass(frozen=True)
class GyroscopicCoupling(Effect):
    """Gyroscopic moments differ from the model's."""

    name = "gyroscopic_coupling"
    physics = "the gyroscopic moments are larger or smaller than polar inertia and speed of the model give"
    equation = "eta'' + (1 + d) Omega G eta' = force"
    signature = "forward and backward whirl apart by another amount; one plane answers the other at speed"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 3"

    def why_not(self, rig: Rig) -> str:
        """A rotor at rest, or without gyroscopic moments in the model."""
        if rig.speed <= 0.0:
            return "the rotor does not turn (speed = 0)"
        if isinstance(rig.rotor, PointMassRotor):
            return "a point mass has no gyroscopic moments"
        if lies_in_one_plane(rig):
            return "all axes lie in one plane, and what guides the rotor across it holds its gyroscopic moments"
        given = rotor_of(rig).gyroscopic.any()
        return "" if given else "the rotor is given without gyroscopic moments (rotor.G or rotor.gyroscopic)"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative error."""
        if self.why_not(rig):
            return []
        meaning = "relative error d of the gyroscopic moments"
        return [EffectParameter("factor", "1", 0.05, lower=-1.0, upper=5.0, meaning=meaning)]

    def attach(self, plant: Plant) -> None:
        """More or less of the moments at this speed."""
        for k, row in enumerate(plant.rotor.gyroscopic):
            for j, g in enumerate(row):
                if g:
                    more = plant.port(self.slot("factor"), plant[f"eta_rate.{j}"], scale=-plant.rig.speed * g)
                    plant.inject(f"modal_force.{k}", more)


@dataclass(frozen=True)
class Unbalance(Wave):
    """A synchronous force that turns with the rotor, at one place or at every bearing.

    Attributes
    ----------
    z : float, optional
        Its place [m]; default: at every bearing.
    reference : int
        Channel whose part at that frequency counts the angle, of y of all axes, then i_c of all axes.
    frequency_hz : float, optional
        Default: that of the rig's speed.
    """

    name = "unbalance"
    physics = "synchronous force, proportional to speed squared"
    equation = "F_x = m e Omega^2 cos(Omega t + angle), F_y = m e Omega^2 sin(Omega t + angle)"
    signature = "one line at the frequency of rotation, forward whirl, whether excited or not"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 6"
    unseen = "no line of the residual turns with the rotor"
    fine = ("frequency_hz", "z")

    z: float | None = None
    reference: int = 0
    frequency_hz: float | None = None

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """At each likely place, and in two planes; the angle is counted from the channel that shows it most.

        It turns with the tone that was found, and at several speeds with each of them.
        """
        near = [tone for tone in seen.tones if is_synchronous(tone, seen)]
        if not near:
            return ()
        places = [*likely_places(seen.rig), None]
        frequency = near[0].frequency_hz if len(seen.speeds) == 1 else None
        return [Unbalance(z, near[0].channel, frequency) for z in places]

    def positions(self, rig: Rig) -> Sequence[float]:
        """Its place."""
        return [] if self.z is None else [self.z]

    def why_not(self, rig: Rig) -> str:
        """A rotor at rest, or one that is not known at its place."""
        if not rig.speed:
            return "the rotor does not turn (speed = 0)"
        return "a point mass does not turn" if isinstance(rig.rotor, PointMassRotor) else super().why_not(rig)

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Mass times eccentricity, in phase with the reference and a quarter turn ahead of it [kg m]."""
        if not rig.speed or isinstance(rig.rotor, PointMassRotor):
            return []
        planes = {"": ""} if self.z is not None else {f"_{b.name}": f", at bearing {b.name}" for b in rig.bearings}
        parts = {"in_phase": "in phase with the reference", "ahead": "a quarter turn ahead of it"}
        return [
            EffectParameter(
                f"{part}{plane}",
                "kg m",
                1e-6,
                lower=-float("inf"),
                meaning=f"mass times eccentricity m e {meaning}{place}",
            )
            for plane, place in planes.items()
            for part, meaning in parts.items()
        ]

    def frequencies_hz(self, rig: Rig) -> Sequence[float]:
        """That of rotation."""
        return [self.frequency_hz or rig.speed / (2.0 * pi)]

    def attach(self, plant: Plant) -> None:
        """The part in phase and the one ahead are m e times the cosine and the sine of the angle."""
        cosine, sine = plant.input("unbalance.cos"), plant.input("unbalance.sin")
        squared = (2.0 * pi * self.frequency_hz) ** 2 if self.frequency_hz else plant.rig.speed**2
        places = [self.z] if self.z is not None else [b.position for b in plant.rig.bearings]
        for place, (in_phase, ahead) in zip(places, self.quarters(plant.rig), strict=True):
            for plane, (a, b) in enumerate([(cosine, -sine), (sine, cosine)][: plant.rotor.planes]):
                force = plant.port(self.slot(in_phase), a, scale=squared) + plant.port(
                    self.slot(ahead), b, scale=squared
                )
                plant.push(place, np.eye(plant.rotor.planes)[plane], force)


EFFECTS = (
    RotorBendingMode(),
    BendingModeShift(),
    RotorInertiaError(),
    GyroscopicCoupling(),
    Unbalance(),
)
