"""Known-shape disturbances: what acts on the machine whether it is excited or not."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.effects.support import likely_places
from ambid.errors import ModelError
from ambid.loop.effect import Effect, EffectParameter, Seen
from ambid.loop.plant import Plant
from ambid.record import Record
from ambid.rig import PointMassRotor, Rig

SIGNALS = {"current": "i_ref", "force": "f"}
"""Ports that a periodic disturbance may act on, and their signals."""
NEAR_SPEED = 0.02
"""Part by which a tone may lie off the speed of the rig file and still be called synchronous."""


class Unbalance(Effect):
    """A synchronous force that turns with the rotor, at one place or at every bearing."""

    name = "unbalance"
    physics = "synchronous force, proportional to speed squared"
    signature = "one line at the frequency of rotation, forward whirl, whether excited or not"
    source = "Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, chapter 6"

    def __init__(self, z: float | None = None, reference: int = 0, frequency_hz: float | None = None) -> None:
        self.z, self.reference, self.frequency_hz = z, reference, frequency_hz

    def settings(self) -> dict[str, Any]:
        """Its place [m], the axis whose displacement counts the angle, and the frequency if not that of the rig."""
        return {"z": self.z, "reference": self.reference, "frequency_hz": self.frequency_hz}

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """At each likely place, and in two planes; the angle is counted from the axis that shows it most."""
        if not seen.rig.speed:
            return ()
        own = seen.rig.speed / (2.0 * pi)
        near = [tone for tone in seen.tones if abs(tone.frequency_hz - own) < NEAR_SPEED * own]
        if not near:
            return ()
        places = [*likely_places(seen.rig), None]
        return [Unbalance(z, near[0].axis, near[0].frequency_hz) for z in places]

    def positions(self, rig: Rig) -> Sequence[float]:
        """Its place."""
        return [] if self.z is None else [self.z]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Mass times eccentricity, in phase with the reference and a quarter turn ahead of it [kg m]."""
        if not rig.speed or isinstance(rig.rotor, PointMassRotor):
            return []
        planes = [""] if self.z is not None else [f"_{bearing.name}" for bearing in rig.bearings]
        names = [f"{part}{plane}" for plane in planes for part in ("in_phase", "ahead")]
        return [EffectParameter(name, "kg m", 1e-6, lower=-float("inf")) for name in names]

    def frequencies_hz(self, rig: Rig) -> Sequence[float]:
        """That of rotation."""
        return [self.frequency_hz or rig.speed / (2.0 * pi)]

    def waveform(self, rig: Rig, samples: int, record: Record | None) -> FloatArray:
        """Cosine and sine of the angle of rotation."""
        return _turning(self.frequencies_hz(rig)[0], rig.sample_rate, samples, record, self.reference)

    def attach(self, plant: Plant) -> None:
        """``F_x = m e Omega^2 cos(Omega t + angle)``, ``F_y`` the sine of it."""
        cosine, sine = plant.input("unbalance.cos"), plant.input("unbalance.sin")
        squared = (2.0 * pi * self.frequency_hz) ** 2 if self.frequency_hz else plant.rig.speed**2
        places = [self.z] if self.z is not None else [b.position for b in plant.rig.bearings]
        names = [p.name for p in self.parameters(plant.rig)]
        for place, in_phase, ahead in zip(places, names[::2], names[1::2], strict=True):
            for plane, (a, b) in enumerate([(cosine, -sine), (sine, cosine)][: plant.rotor.planes]):
                force = plant.port(self.slot(in_phase), a, scale=squared) + plant.port(
                    self.slot(ahead), b, scale=squared
                )
                plant.push(place, np.eye(plant.rotor.planes)[plane], force)


class PeriodicDisturbance(Effect):
    """A force or a current at a frequency of its own, at one axis, at all alike, or at each with its own amplitude."""

    name = "periodic_disturbance"
    physics = "a force or current at a fixed frequency, such as mains hum"
    signature = "one line that belongs neither to the excitation nor to the speed"
    source = "Pintelon, Schoukens, System Identification, 2nd ed., chapter 2"

    def __init__(
        self, frequency_hz: float = 50.0, port: str = "current", axis: int | str = "all", reference: int = 0
    ) -> None:
        self.frequency_hz, self.port, self.axis, self.reference = frequency_hz, port, axis, reference

    def settings(self) -> dict[str, Any]:
        """Frequency [Hz], port, axis, and the axis whose displacement counts the phase."""
        return {
            "frequency_hz": self.frequency_hz,
            "port": self.port,
            "axis": self.axis,
            "reference": self.reference,
        }

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Each tone that is not synchronous, as a current and as a force, at each axis and at all."""
        own = seen.rig.speed / (2.0 * pi)
        tones = [t for t in seen.tones if not abs(t.frequency_hz - own) < NEAR_SPEED * own]
        axes = [*range(len(seen.rig.axes)), "all", "each"] if len(seen.rig.axes) > 1 else [0]
        return [
            PeriodicDisturbance(tone.frequency_hz, port, axis, tone.axis)
            for tone in tones[:2]
            for port in ("current", "force")
            for axis in axes
        ]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Amplitudes in phase with the reference and a quarter period behind it [A or N]."""
        unit, size = ("A", 1e-3) if self.port == "current" else ("N", 0.1)
        places = [f"_{axis}" for axis in rig.axes] if self.axis == "each" else [""]
        names = [f"{part}{place}" for place in places for part in ("cosine", "sine")]
        return [EffectParameter(name, unit, size, lower=-float("inf")) for name in names]

    def frequencies_hz(self, rig: Rig) -> Sequence[float]:
        """Its own."""
        return [self.frequency_hz]

    def waveform(self, rig: Rig, samples: int, record: Record | None) -> FloatArray:
        """Cosine and sine at the frequency."""
        return _turning(self.frequency_hz, rig.sample_rate, samples, record, self.reference)

    def attach(self, plant: Plant) -> None:
        """Added to the command of the amplifiers, or to the force of the magnets."""
        inputs = [plant.input("disturbance.cos"), plant.input("disturbance.sin")]
        if self.port not in SIGNALS:
            raise ModelError(f"periodic_disturbance: port = {self.port!r}; expected {' or '.join(SIGNALS)}")
        signal = SIGNALS[self.port]
        names = [p.name for p in self.parameters(plant.rig)]
        hit = self._hit(plant.axes)
        for k, axis in enumerate(hit):
            own = names[2 * k : 2 * k + 2] if self.axis == "each" else names
            for name, wave in zip(own, inputs, strict=True):
                plant.inject(f"{signal}.{axis}", plant.port(self.slot(name), wave))

    def _hit(self, axes: Sequence[str]) -> Sequence[str]:
        """Axes that it acts on."""
        if self.axis in ("all", "each"):
            return axes
        if self.axis in axes:
            return [str(self.axis)]
        if isinstance(self.axis, int) and 0 <= self.axis < len(axes):
            return [axes[self.axis]]
        raise ModelError(f"periodic_disturbance: axis = {self.axis!r}; expected all, each, or {', '.join(axes)}")


def _turning(frequency: float, sample_rate: float, samples: int, record: Record | None, reference: int) -> FloatArray:
    """Cosine and sine, shape (samples, 2), that count their angle from that of a record's displacement.

    The start of a record has no fixed angle to the rotor or to the mains; the displacement of one axis at that
    frequency has.
    """
    angle = 2.0 * pi * frequency / sample_rate * np.arange(samples)
    if record is not None:
        whole = slice(record.period or 0, samples)
        y = record.y[whole, reference]
        if record.period is not None:
            y = y - np.resize(y[: len(y) // record.period * record.period].reshape(-1, record.period).mean(0), len(y))
        table = np.column_stack([np.cos(angle[whole]), np.sin(angle[whole])])
        cosine, sine = np.linalg.lstsq(table, y - y.mean(), rcond=None)[0]
        angle = angle + np.arctan2(-sine, cosine)
    return np.column_stack([np.cos(angle), np.sin(angle)])
