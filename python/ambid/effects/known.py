"""Values of the rig file that are known to a tolerance: what an error of each does to the loop.

Each is an effect like those of the catalogue, whose parameters have a standard deviation from the rig file's
[tolerance] in place of nothing known; where the catalogue has the same physics, the same equations serve both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from ambid.effects.places import about, moved_along, of_two_axes
from ambid.effects.rotor import RotorInertiaError, divide_forces, kept_modes
from ambid.effects.sensor import SamplingSkew, SensorMisalignment, SensorPositionError
from ambid.effects.slips import LEAST, ControllerGainError
from ambid.effects.updates import (
    with_bearing,
    with_controller_gain,
    with_damping,
    with_frequency,
    with_inertia,
    with_slower,
)
from ambid.errors import RigError
from ambid.loop.assembly import combine
from ambid.loop.effect import Effect, EffectParameter
from ambid.loop.geometry import rotor_of
from ambid.loop.plant import Plant
from ambid.rig import MatrixRotor, PointMassRotor, Rig

FARTHEST = 5.0
"""Standard deviations beyond which a value is not known to its tolerance: one in 1.7 million is off by more, and what a
record calls for there is an effect."""


class Known(Effect):
    """A value of the rig file, or one a bearing, axis or mode, with its tolerance.

    Attributes
    ----------
    key : str
        Of the rig file's [tolerance].
    unit : str
        Of the error: ``1`` for a relative one.
    factor : float
        From the unit of the key to that of the error.
    no_key : str
        Why no key of the rig file holds an error of it, and what to correct instead; empty where one does.
    """

    key: ClassVar[str]
    unit: ClassVar[str] = "1"
    factor: ClassVar[float] = 1.0
    no_key: ClassVar[str] = ""
    signature = "none of its own: it is a value that the rig file gives"
    source = "JCGM 100:2008 (GUM), 4.3"

    def members(self, rig: Rig) -> Sequence[str]:
        """What the errors are of, such as axes; an empty name for the whole machine; none where there is no such."""
        return rig.axes

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """The error of each member; none where the value is exact."""
        std = self.factor * rig.known_to(self.key)
        if std == 0.0:
            return []
        meaning, lower = f"error of {self.key} in the rig file", -FARTHEST * std
        if self.unit == "1":
            lower = max(lower, LEAST)
        return [
            EffectParameter(name, self.unit, std, lower, FARTHEST * std, meaning=meaning, std=std)
            for name in self.members(rig)
        ]

    why_not = Effect.why_not

    def updated(self, rig: Rig, errors: Mapping[str, float]) -> tuple[Rig, dict[str, tuple[float, str]]]:
        """The rig whose keys hold these errors, and what of each they do not hold, with the reason.

        A model of it without errors responds as one of `rig` with them; along the shaft to first order in the offset.

        Parameters
        ----------
        rig : Rig
        errors : mapping of str to float
            By the name of the parameter.
        """
        left: dict[str, tuple[float, str]] = {}
        for name, error in errors.items():
            try:
                new, why = self._with(rig, name, error), self.no_key
            except RigError as refused:  # such as a place off the shaft
                new, why = None, _last_line(refused)
            if new is None:
                left[name] = error, why
            rig = rig if new is None else new
        return rig, left

    def _with(self, rig: Rig, parameter: str, error: float) -> Rig | None:
        """The rig whose keys hold one error; None where none does."""
        return None

    def slot(self, parameter: str) -> str:
        """Such as ``sensor_gain.A_zeta``, or ``mass`` alone."""
        return f"{self.key}.{parameter}" if parameter else self.key


def _last_line(error: RigError) -> str:
    """What is wrong, of an error that may begin with how many problems there are."""
    return str(error).splitlines()[-1].strip()


class _OfRotor(Known, RotorInertiaError):
    """Mass or inertia of a rigid rotor: also where K_i and K_s absorb it."""

    no_key = "that of a shaft is the sum of its sections and disks: correct their sizes, density or masses"

    def members(self, rig: Rig) -> Sequence[str]:
        """The rotor, where its rigid modes are translation and rotation; a point mass has a mass."""
        if isinstance(rig.rotor, PointMassRotor):
            return [""] if self.key == "mass" else []
        return [""] if rotor_of(rig).rigid_modes == 2 else []

    def attach(self, plant: Plant) -> None:
        """The force of the motion is divided by 1 + d."""
        is_point = isinstance(plant.rig.rotor, PointMassRotor)
        divide_forces(plant, {self.slot(""): np.ones(1) if is_point else plant.rotor.rigid_motions()[self.key]})

    def _with(self, rig: Rig, parameter: str, error: float) -> Rig | None:
        return with_inertia(rig, self.key, error)


@dataclass(frozen=True)
class KnownMass(_OfRotor):
    """Mass of the rotor."""

    name = key = "mass"
    physics = "the mass of the rotor"


@dataclass(frozen=True)
class KnownInertia(_OfRotor):
    """Transverse inertia of the rotor."""

    name = key = "inertia"
    physics = "the transverse inertia of the rotor"


class _AlongShaft(Known):
    """A place of each bearing along the shaft."""

    unit = "m"
    no_key = "a rotor given by its matrices is known at its nodes alone: give it one there"

    def members(self, rig: Rig) -> Sequence[str]:
        """Every bearing; a point mass is the same everywhere."""
        return [] if isinstance(rig.rotor, PointMassRotor) else [b.name for b in rig.bearings]

    def _with(self, rig: Rig, parameter: str, error: float) -> Rig | None:
        return None if isinstance(rig.rotor, MatrixRotor) else with_bearing(rig, parameter, self.key, error)


@dataclass(frozen=True)
class KnownPosition(_AlongShaft):
    """Places of the magnets."""

    name = key = "position"
    physics = "the places of the magnets along the shaft"
    equation = "s and v of z + dz, and the force acts there"

    def positions(self, rig: Rig) -> Sequence[float]:
        """Some about every magnet, between which the shapes are known."""
        return about(rig, [b.position for b in rig.bearings])

    def attach(self, plant: Plant) -> None:
        """Exact to third order in the offset, as the shapes of beams are between nodes."""
        own = [b.position for b in plant.rig.bearings]
        read = [
            (signal, [plant[f"{of}.{k}"] for k in range(plant.coordinates)])
            for signal, of in (("s", "eta"), ("v", "eta_rate"))
        ]
        for bearing, axis, parts in moved_along(plant, own, self.positions(plant.rig)):
            for power, part in enumerate(parts, 1):
                for signal, of_modes in read:
                    moved = plant.port(self.slot(bearing.name), combine(part, of_modes), power=power)
                    plant.inject(f"{signal}.{axis}", moved)
                force = plant.port(self.slot(bearing.name), plant[f"f.{axis}"], power=power)
                for k, onto in enumerate(part):
                    if onto:
                        plant.inject(f"modal_force.{k}", onto * force)


@dataclass(frozen=True)
class KnownSensorPosition(_AlongShaft, SensorPositionError):
    """Places of the sensors."""

    name = key = "sensor_position"

    def slot(self, parameter: str) -> str:
        """Such as ``sensor_position.A``."""
        return super().slot(parameter.removeprefix("offset_"))


@dataclass(frozen=True)
class KnownSensorAngle(Known, SensorMisalignment):
    """Angles of the sensors against the magnets."""

    name = key = "sensor_angle"
    no_key = "the sensors of a bearing are aligned with its magnets: turn them, or the recorded y"
    unit, factor = "rad", pi / 180.0

    def members(self, rig: Rig) -> Sequence[str]:
        """Bearings of two axes."""
        return [b.name for b in of_two_axes(rig)]

    def slot(self, parameter: str) -> str:
        """Such as ``sensor_angle.A``."""
        return super().slot(parameter.removeprefix("angle_"))


class _OfReading(Known):
    """Gains of a reading of every axis."""

    signal: ClassVar[str]

    def attach(self, plant: Plant) -> None:
        """At every axis."""
        for axis in plant.axes:
            plant.scale(f"{self.signal}.{axis}", self.slot(axis))


@dataclass(frozen=True)
class KnownSensorGain(_OfReading):
    """Gains of all sensors, those too that K_i absorbs."""

    name = key = "sensor_gain"
    signal = "scaled"
    no_key = "y is as it was recorded: correct the calibration of the channel"
    physics = "the gains of the displacement sensors"
    equation = "y = (1 + g) y_true"


@dataclass(frozen=True)
class KnownCurrentGain(_OfReading):
    """Gains of the current readings."""

    name = key = "current_gain"
    signal = "i_c"
    no_key = "i_c is as it was recorded: correct the calibration of the channel"
    physics = "the gains of the current readings"
    equation = "i_c = (1 + g) i_a"


@dataclass(frozen=True)
class KnownExcitationGain(Known):
    """Scale of the excitation."""

    name = key = "excitation_gain"
    no_key = "i_e is as it was recorded: correct its scale"
    physics = "the scale of the excitation"
    equation = "i_ref = -K y + (1 + e) i_e"

    def members(self, rig: Rig) -> Sequence[str]:
        """All axes together."""
        return [""]

    def attach(self, plant: Plant) -> None:
        """The same on every axis."""
        plant.scale_excitation(self.slot(""))


@dataclass(frozen=True)
class KnownInstant(Known, SamplingSkew):
    """Instants of currents against displacements."""

    name = key = "instant"
    no_key = "i_c is as it was recorded: move the channel in time"
    unit = "s"

    def members(self, rig: Rig) -> Sequence[str]:
        """All currents together, where they move between the samples."""
        return [""] if rig.amplifier.time_constant > 0.0 else []

    def slot(self, parameter: str) -> str:
        """The key alone."""
        return self.key

    def _reads_y_early(self, rig: Rig) -> bool:
        return False


@dataclass(frozen=True)
class KnownBendingFrequency(Known):
    """Frequencies of the kept bending modes."""

    name = key = "bending_frequency"
    physics = "the frequencies of the bending modes"
    equation = "eta'' + 2 zeta w eta' + (1 + 2 d) w^2 eta = force"

    def members(self, rig: Rig) -> Sequence[str]:
        """Every kept mode, from 1 on."""
        return [str(k) for k in range(1, rig.rotor.bending_modes + 1)]

    def attach(self, plant: Plant) -> None:
        """Stiffness beside that of the mode."""
        for k, mode, w in kept_modes(plant):
            stiffer = plant.port(self.slot(str(mode)), plant[f"eta.{k}"], scale=2.0 * w**2)
            plant.inject(f"modal_force.{k}", -stiffer)

    def _with(self, rig: Rig, parameter: str, error: float) -> Rig:
        return with_frequency(rig, int(parameter), error)


@dataclass(frozen=True)
class KnownModalDamping(Known):
    """Damping of the kept bending modes."""

    name = key = "modal_damping"
    physics = "the damping of the bending modes"
    equation = "eta'' + 2 (1 + d) zeta w eta' + w^2 eta = force"

    def members(self, rig: Rig) -> Sequence[str]:
        """Every kept mode that is damped, from 1 on."""
        rotor = rotor_of(rig)
        count = rig.rotor.bending_modes
        return [str(k) for k in range(1, count + 1) if rotor.damping[rotor.rigid_modes + k - 1] > 0.0]

    def attach(self, plant: Plant) -> None:
        """Damping beside that of the mode."""
        for k, mode, w in kept_modes(plant):
            zeta = plant.rotor.damping[plant.rotor.rigid_modes + mode - 1]
            if zeta > 0.0:
                damped = plant.port(self.slot(str(mode)), plant[f"eta_rate.{k}"], scale=2.0 * w * zeta)
                plant.inject(f"modal_force.{k}", -damped)

    def _with(self, rig: Rig, parameter: str, error: float) -> Rig:
        return with_damping(rig, int(parameter), error)


@dataclass(frozen=True)
class KnownAmplifier(Known):
    """Time constants of the amplifiers."""

    name = key = "amplifier_time_constant"
    no_key = "all axes have one time constant, which has the mean of their errors"
    physics = "the time constants of the amplifiers"
    equation = "(1 + d) tau_a i_a' = i_set - i_a"

    def members(self, rig: Rig) -> Sequence[str]:
        """Every axis, where amplifiers have a lag."""
        return rig.axes if rig.amplifier.time_constant > 0.0 else []

    def attach(self, plant: Plant) -> None:
        """The rates of the amplifier's states are divided by 1 + d."""
        for axis in plant.axes:
            for rate in plant.amplifier_rates[axis]:
                plant.inject(rate, -plant.port(self.slot(axis), plant[rate]))

    def updated(self, rig: Rig, errors: Mapping[str, float]) -> tuple[Rig, dict[str, tuple[float, str]]]:
        """All axes have one time constant, which takes the mean of their errors; what sets axes apart has no key."""
        common = sum(errors.values()) / len(errors)
        try:
            slower = with_slower(rig, common)
        except RigError as refused:
            return rig, {name: (error, _last_line(refused)) for name, error in errors.items()}
        apart = {name: ((1.0 + error) / (1.0 + common) - 1.0, self.no_key) for name, error in errors.items()}
        return slower, apart if len(errors) > 1 else {}


@dataclass(frozen=True)
class KnownControllerGain(Known, ControllerGainError):
    """Gains of an analog controller."""

    name = key = "controller_gain"

    def members(self, rig: Rig) -> Sequence[str]:
        """Every gain of a PID, or the whole of any other controller."""
        return rig.controller.gains

    def _with(self, rig: Rig, parameter: str, error: float) -> Rig:
        return with_controller_gain(rig, parameter, error)


KNOWN: tuple[Known, ...] = (
    KnownMass(),
    KnownInertia(),
    KnownPosition(),
    KnownSensorPosition(),
    KnownSensorAngle(),
    KnownSensorGain(),
    KnownCurrentGain(),
    KnownExcitationGain(),
    KnownInstant(),
    KnownBendingFrequency(),
    KnownModalDamping(),
    KnownAmplifier(),
    KnownControllerGain(),
)
"""One for every key of [tolerance] that acts on the linear loop."""
