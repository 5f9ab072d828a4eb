"""Disturbances of known shape: what acts on the machine from outside, whether it is excited or not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

from ambid.effects.waves import Wave, harmonic, is_synchronous
from ambid.errors import ModelError
from ambid.findings import NOWHERE, Finding, Kind
from ambid.loop.effect import Effect, EffectParameter, Seen
from ambid.loop.plant import Plant
from ambid.rig import PointMassRotor, Rig

SIGNALS = {"current": "i_ref", "force": "f"}
"""Ports that a periodic disturbance may act on, and their signals."""
ANYWHERE = Kind(
    "disturbance_place_unknown",
    "note",
    "{effect}: on one axis a force, a current and a hum of the sensor give the same record",
    "hold the mass still and record y, to see that of the sensor alone",
)


@dataclass(frozen=True)
class PeriodicDisturbance(Wave):
    """A force or a current at a frequency of its own, at one axis, at all alike, or at each with its own amplitude.

    Attributes
    ----------
    frequency_hz : float
    port : str
        ``current`` or ``force``.
    axis : int or str
        Index or name of an axis, ``all`` or ``each``.
    reference : int
        Channel whose part at that frequency counts the phase, of y of all axes, then i_c of all axes.
    """

    name = "periodic_disturbance"
    physics = "a force or current at a fixed frequency, such as mains hum"
    equation = "i_ref or f + a cos(w t) + b sin(w t), w = 2 pi frequency_hz"
    signature = "one line that belongs neither to the excitation nor to the speed"
    source = "Pintelon, Schoukens, System Identification, 2nd ed., chapter 2"
    unseen = "the residual has no line of its own beside those of the excitation and the speed"
    fine = ("frequency_hz",)

    frequency_hz: float = 50.0
    port: str = "current"
    axis: int | str = "all"
    reference: int = 0

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Each tone that is not synchronous, as a current and as a force, at each axis and at all."""
        tones = [tone for tone in seen.tones if not is_synchronous(tone, seen)]
        axes = [*range(len(seen.rig.axes)), "all", "each"] if len(seen.rig.axes) > 1 else [0]
        return [
            PeriodicDisturbance(tone.frequency_hz, port, axis, tone.channel)
            for tone in tones[:2]
            for port in ("current", "force")
            for axis in axes
        ]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Amplitudes in phase with the reference and a quarter period behind it, in the unit of commands or N."""
        unit, size = (rig.amplifier.command_unit, 1e-3) if self.port == "current" else ("N", 0.1)
        places = {f"_{axis}": f", at {axis}" for axis in rig.axes} if self.axis == "each" else {"": ""}
        own = f"of a {self.port} of {self.frequency_hz:.5g} Hz"
        parts = {"cosine": f"a {own} in phase with the reference", "sine": f"b {own} a quarter period behind it"}
        return [
            EffectParameter(f"{part}{end}", unit, size, lower=-float("inf"), meaning=f"amplitude {meaning}{place}")
            for end, place in places.items()
            for part, meaning in parts.items()
        ]

    def frequencies_hz(self, rig: Rig) -> Sequence[float]:
        """Its own."""
        return [self.frequency_hz]

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """That one axis does not show where it comes in."""
        return [ANYWHERE(NOWHERE, effect=self.name)] if values is not None and len(rig.axes) == 1 else []

    def attach(self, plant: Plant) -> None:
        """Added to the command of the amplifiers, or to the force of the magnets."""
        inputs = [plant.input("disturbance.cos"), plant.input("disturbance.sin")]
        if self.port not in SIGNALS:
            raise ModelError(f"periodic_disturbance: port = {self.port!r}; expected {' or '.join(SIGNALS)}")
        signal = SIGNALS[self.port]
        pairs, hit = self.quarters(plant.rig), self._hit(plant.axes)
        for k, axis in enumerate(hit):
            pair = pairs[k if self.axis == "each" else 0]
            for name, wave in zip(pair, inputs, strict=True):
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


@dataclass(frozen=True)
class SensorRunout(Wave):
    """What the surface under the displacement sensors adds to their reading, at the speed or at a multiple of it.

    Attributes
    ----------
    harmonic : int
        Times the frequency of rotation.
    reference : int
        Channel whose part at that frequency counts the angle, of y of all axes, then i_c of all axes.
    frequency_hz : float, optional
        Default: that of the harmonic of the rig's speed.
    """

    name = "sensor_runout"
    physics = "the surface under the sensors is not round, or not of one material: a wave of the angle in their reading"
    equation = "y = y_true + a cos(k Omega t) + b sin(k Omega t), on every axis its own"
    signature = "a line at the speed or a multiple of it in y, to which no force belongs but that of the controller"
    source = "ISO 14839-1; Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 3"
    unseen = "no line of the residual is one of the speed or a multiple of it"
    formula_error = 1e-3  # its wave is held over a sample, so that an analog controller reads it half a sample late
    fine = ("frequency_hz",)

    harmonic: int = 1
    reference: int = 0
    frequency_hz: float | None = None

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Each line that turns with the rotor; at several speeds with each of them."""
        found = [(times, tone) for tone in seen.tones if (times := harmonic(tone, seen))]
        alone = len(seen.speeds) == 1
        return [SensorRunout(times, tone.channel, tone.frequency_hz if alone else None) for times, tone in found[:2]]

    def why_not(self, rig: Rig) -> str:
        """A rotor at rest."""
        if isinstance(rig.rotor, PointMassRotor):
            return "a point mass does not turn"
        return "" if rig.speed else "the rotor does not turn (speed = 0)"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Amplitudes in phase with the reference and a quarter period behind it, of every axis [m]."""
        if self.why_not(rig):
            return []
        parts = {"cosine": "in phase with the reference", "sine": "a quarter period behind it"}
        own = f"of what the sensor reads at {self.harmonic} times the frequency of rotation"
        return [
            EffectParameter(
                f"{part}_{axis}", "m", 1e-7, lower=-float("inf"), meaning=f"amplitude {own}, {meaning}, at {axis}"
            )
            for axis in rig.axes
            for part, meaning in parts.items()
        ]

    def frequencies_hz(self, rig: Rig) -> Sequence[float]:
        """That of the harmonic."""
        return [self.frequency_hz or self.harmonic * rig.speed / (2.0 * pi)]

    def attach(self, plant: Plant) -> None:
        """Added to what the sensors read, and the controller with them."""
        waves = [plant.input("runout.cos"), plant.input("runout.sin")]
        for axis, pair in zip(plant.axes, self.quarters(plant.rig), strict=True):
            for name, wave in zip(pair, waves, strict=True):
                plant.inject(f"scaled.{axis}", plant.port(self.slot(name), wave))


EFFECTS = (
    PeriodicDisturbance(),
    SensorRunout(),
)
