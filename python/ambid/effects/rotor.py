"""Effects of the rotor itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi

import numpy as np

from ambid.loop.assembly import combine
from ambid.loop.effect import Effect, EffectParameter, Seen
from ambid.loop.plant import Plant
from ambid.rig import FiniteElementRotor, MatrixRotor, Rig
from ambid.rotor import reduced_rotor, with_more_modes


class RotorBendingMode(Effect):
    """Bending modes that the base model left out."""

    name = "rotor_bending_mode"
    physics = "the rotor bends in modes that the base model left out"
    signature = "narrow peaks near the free-free bending frequencies, in y and i_c"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapters 5 and 6"

    def __init__(self, participation: float = 1.0) -> None:
        self.participation = participation

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Modes that take part as computed, and weaker ones, which the loop moves less."""
        return [RotorBendingMode(share) for share in (1.0, 0.1, 0.01)]

    def flexible_modes(self, rig: Rig) -> int:
        """How many further modes lie well below half the sample rate; two at the most."""
        if not isinstance(rig.rotor, FiniteElementRotor | MatrixRotor):
            return 0
        rotor = reduced_rotor(with_more_modes(rig.rotor, 2), [b.position for b in rig.bearings])
        return sum(f < 0.4 * rig.sample_rate for f in rotor.frequencies_rad_s[-2:] / (2.0 * pi))

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Frequency [Hz], damping ratio and participation of each further mode."""
        more = self.flexible_modes(rig)
        if more == 0:
            return []
        rotor = reduced_rotor(with_more_modes(rig.rotor, more), [b.position for b in rig.bearings])
        found = rotor.frequencies_rad_s[-more:] / (2.0 * pi)
        given = getattr(rig.rotor, "modal_damping", 0.0)
        likely = given if isinstance(given, float) else next(iter(given[::-1]), 0.0)
        damping = likely if likely > 0.0 else 0.003
        parameters = []
        for k, frequency in enumerate(found, start=1):
            parameters += [
                EffectParameter(f"frequency_{k}_hz", "Hz", float(frequency), 0.7 * frequency, 1.4 * frequency),
                EffectParameter(f"damping_{k}", "1", damping, lower=1e-5, upper=0.3),
                EffectParameter(f"participation_{k}", "1", self.participation, upper=4.0),
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

    def attach(self, plant: Plant) -> None:
        """``eta'' = -w^2 eta - 2 zeta w eta' + p force``: 1 is a mode whose shape is right at magnets and sensors.

        Gyroscopic moments are among the forces, so that a mode that takes no part is none.
        """
        more = self.flexible_modes(plant.rig)
        n = len(plant.rotor.frequencies_rad_s)
        rates = [plant[f"eta_rate.{k}"] for k in range(plant.coordinates)]
        for j in range(more):
            frequency, damping = self.slot(f"frequency_{j + 1}_hz"), self.slot(f"damping_{j + 1}")
            for plane in range(plant.rotor.planes):
                k = plane * n + n - more + j
                turning = combine(-plant.rig.speed * plant.rotor.gyroscopic[k], rates)
                force = plant.raw(f"modal_force.{k}") + turning
                taking_part = plant.port(self.slot(f"participation_{j + 1}"), force) - force
                w_eta = plant.port(frequency, plant[f"eta.{k}"], scale=2.0 * pi)
                damped = plant.port(damping, plant[f"eta_rate.{k}"], scale=2.0)
                held = plant.port(frequency, w_eta + damped, scale=2.0 * pi)
                plant.inject(f"modal_force.{k}", taking_part - held)


class BendingModeShift(Effect):
    """Frequency and damping of kept modes differ from the model's."""

    name = "bending_mode_shift"
    physics = "a kept bending mode has another frequency or damping than the model says"
    signature = "a narrow peak at a kept bending frequency that changes sign across it"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 5"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative shift of the squared frequency, and of the damping [times the critical], of each kept mode."""
        if rig.rotor.kind == "mass":
            return []
        kept = _flexible(rig)
        parameters = []
        for k in range(1, kept + 1):
            parameters += [
                EffectParameter(f"squared_frequency_{k}", "1", 1e-3, lower=-0.6, upper=0.6),
                EffectParameter(f"damping_{k}", "1", 3e-4, lower=-0.02, upper=0.3),
            ]
        return parameters

    def attach(self, plant: Plant) -> None:
        """``eta'' -= d w^2 eta + 2 z w eta'``."""
        n = len(plant.rotor.frequencies_rad_s)
        first = 2
        for j in range(_flexible(plant.rig)):
            w = plant.rotor.frequencies_rad_s[first + j]
            for plane in range(plant.rotor.planes):
                k = plane * n + first + j
                stiffer = plant.port(self.slot(f"squared_frequency_{j + 1}"), plant[f"eta.{k}"], scale=w**2)
                damped = plant.port(self.slot(f"damping_{j + 1}"), plant[f"eta_rate.{k}"], scale=2.0 * w)
                plant.inject(f"modal_force.{k}", -stiffer - damped)


def _flexible(rig: Rig) -> int:
    """Bending modes per plane that the rig's model keeps."""
    return rig.rotor.flexible_modes if isinstance(rig.rotor, FiniteElementRotor | MatrixRotor) else 0


class RotorInertiaError(Effect):
    """Mass or transverse inertia differ from the model's."""

    name = "rotor_inertia_error"
    physics = "the mass or the transverse inertia of the rotor differs from the model's"
    signature = "rigid-body motion at high frequency too large or too small, at every amplitude"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 3"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative errors of transverse inertia and mass; that of the mass shows against the bending modes alone.

        Without bending modes a gain common to all modes is one of K_i and K_s.
        """
        if not isinstance(rig.rotor, FiniteElementRotor | MatrixRotor):
            return []
        names = ["inertia", "mass"] if rig.rotor.flexible_modes else ["inertia"]
        return [EffectParameter(name, "1", 0.01, lower=-0.5, upper=1.0) for name in names]

    def attach(self, plant: Plant) -> None:
        """``(1 + d) eta'' = force`` of rotation and translation, so that the force there is divided by 1 + d."""
        n = len(plant.rotor.frequencies_rad_s)
        modes = {"mass": 0, "inertia": 1}
        for plane in range(plant.rotor.planes):
            for parameter in self.parameters(plant.rig):
                k = plane * n + modes[parameter.name]
                heavier = plant.port(self.slot(parameter.name), plant[f"modal_force.{k}"])
                plant.inject(f"modal_force.{k}", -heavier)


class GyroscopicCoupling(Effect):
    """Gyroscopic moments differ from the model's."""

    name = "gyroscopic_coupling"
    physics = "the gyroscopic moments are larger or smaller than polar inertia and speed of the model give"
    signature = "forward and backward whirl apart by another amount; one plane answers the other at speed"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 3"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative error."""
        return [EffectParameter("factor", "1", 0.05, lower=-1.0, upper=5.0)] if rig.speed > 0.0 else []

    def attach(self, plant: Plant) -> None:
        """``eta'' -= d speed G eta'``."""
        for k, row in enumerate(plant.rotor.gyroscopic):
            for j, g in enumerate(row):
                if g:
                    more = plant.port(self.slot("factor"), plant[f"eta_rate.{j}"], scale=-plant.rig.speed * g)
                    plant.inject(f"modal_force.{k}", more)
