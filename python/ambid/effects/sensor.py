"""Effects in the displacement sensors and in the recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from ambid.effects.places import about, moved_along, of_two_axes
from ambid.effects.traits import CURVATURE, GAIN_OF_READING, LAG_OF_CURRENT, LAG_OF_READING, LAG_ROUND_LOOP
from ambid.loop.assembly import combine
from ambid.loop.effect import Effect, EffectParameter, Seen, Trait
from ambid.loop.plant import Plant
from ambid.record import Record
from ambid.record.shifting import shifted
from ambid.rig import Bearing, PointMassRotor, Rig, StateSpaceController

APART = 5.0
"""Degrees beyond right angles from which bearings count as turned against each other: the gain of one plane against the
other then shows by sin(2 x 5 degrees), a sixth of what it does at 45."""
REACH = 20.0
"""Samples by which a reading may be late or early."""


@dataclass(frozen=True)
class SensorLag(Effect):
    """First-order bandwidth of the displacement sensors."""

    name = "sensor_lag"
    physics = "the displacement sensor and its filter follow the rotor with a first-order lag"
    equation = "tau y' = y_true - y"
    in_series = MappingProxyType({"time_constant": "tau_e"})
    signature = "y too small and late at high frequency; the loop loses damping, while i_c follows i_e as modelled"
    source = "ISO 14839-3; Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 3"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Time constant [s]."""
        sample = 1.0 / rig.sample_rate
        meaning = "time constant tau of the sensor's first-order lag"
        return [EffectParameter("time_constant", "s", 0.05 * sample, lower=5e-5 * sample, upper=0.1, meaning=meaning)]

    def far_starts(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """A sample, and ten, as a loop answers within some ten: the fit takes a long lag for one of the magnet."""
        return [{"time_constant": count / rig.sample_rate} for count in (1.0, 10.0)]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Its time constant."""
        return dict.fromkeys((LAG_OF_READING, LAG_ROUND_LOOP), values["time_constant"])

    def attach(self, plant: Plant) -> None:
        """A lag of the same time constant for each axis."""
        for axis in plant.axes:
            true = plant.raw(f"y.{axis}")
            read = plant.lag(f"sensor.{axis}", true, self.slot("time_constant"))
            plant.inject(f"y.{axis}", read - true)


@dataclass(frozen=True)
class SensorGainError(Effect):
    """Gains of single sensors; what K_i absorbs is left out, a gain common to all sensors of one plane.

    Attributes
    ----------
    between_planes : bool
        Whether one plane's gain against the other's is estimated, too; a rotor that turns, or a controller or another
        effect that acts from one plane to the other, may show it; bearings that are turned against each other always
        do.
    """

    name = "sensor_gain_error"
    physics = "single sensors read too large or too small; only their ratio within a plane is identifiable"
    equation = "y = (1 + g) y_true at the first bearing, y = (1 - g) y_true at the second; others y = (1 + g) y_true"
    signature = "rigid-body modes shift between the bearings in one plane, the same at every amplitude"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 3"

    between_planes: bool = False

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """With and without a gain between planes that act on each other."""
        is_matrix = isinstance(seen.rig.controller, StateSpaceController)
        acts = is_matrix or seen.across_planes or bool(seen.speeds - {0.0})
        return [SensorGainError(apart) for apart in (False, True)[: 1 + acts]]

    def why_not(self, rig: Rig) -> str:
        """No two sensors in one plane."""
        why = "no plane has two sensors, and a gain common to a plane is one of K_i and K_s"
        return "" if self._gains(rig) else why

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative gain errors, see `_gains`."""
        return [
            EffectParameter(name, "1", 0.01, lower=-0.5, upper=0.5, meaning=_meaning(own))
            for name, own in self._gains(rig).items()
        ]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """The largest of its gains."""
        return {GAIN_OF_READING: max(map(abs, values.values()))}

    def attach(self, plant: Plant) -> None:
        """At every sensor that a gain acts on."""
        for name, own in self._gains(plant.rig).items():
            for axis, sign in own.items():
                plant.inject(f"scaled.{axis}", plant.port(self.slot(name), plant.raw(f"scaled.{axis}"), scale=sign))

    def _gains(self, rig: Rig) -> dict[str, dict[str, float]]:
        """Gains that no K_i absorbs: the sensors of each, by axis, and the signs it has there.

        In each plane one of the first bearing's sensor against the second's, and one of each further sensor. Where the
        planes act on each other, only a gain of all sensors is absorbed: then there is one of all zeta against all eta,
        too.
        """
        planes, found = _planes(rig), dict[str, dict[str, float]]()
        for direction, axes in planes.items():
            if len(axes) > 1:
                found[direction] = {axes[0]: 1.0, axes[1]: -1.0}
                found |= {axis: {axis: 1.0} for axis in axes[2:]}
        if len(found) > 1 and (self.between_planes or _are_turned(rig)):
            signs = dict(zip(planes, (1.0, -1.0), strict=True))
            found["planes"] = {axis: signs[direction] for direction, axes in planes.items() for axis in axes}
        return found


def _are_turned(rig: Rig) -> bool:
    """Whether bearings are turned against each other, other than by right angles."""
    return any(abs(b.tilt - 90.0 * _turns(rig, b) - rig.bearings[0].tilt) > APART for b in rig.bearings)


def _planes(rig: Rig) -> dict[str, list[str]]:
    """Axes that lie in one plane, or nearest to it, by their direction at the first bearing."""
    turned = {"zeta": "eta", "eta": "zeta"}
    found: dict[str, list[str]] = {"zeta": [], "eta": []}
    for bearing in rig.bearings:
        for direction, axis in zip(bearing.axes, bearing.axis_names, strict=True):
            found[turned[direction] if _turns(rig, bearing) % 2 else direction].append(axis)
    return found


def _turns(rig: Rig, bearing: Bearing) -> int:
    """Right angles from the axes of the first bearing to those of this one, the nearest number of them."""
    return round((bearing.tilt - rig.bearings[0].tilt) / 90.0)


def _meaning(own: Mapping[str, float]) -> str:
    """Of a gain that acts on these axes."""
    above, below = (", ".join(axis for axis, sign in own.items() if sign == wanted) for wanted in (1.0, -1.0))
    return f"relative gain error g of the sensor of {above}" + (f", and -g of {below}" if below else "")


@dataclass(frozen=True)
class SensorMisalignment(Effect):
    """Sensor axes rotated against the actuator axes."""

    name = "sensor_misalignment"
    physics = "the sensors of a bearing are rotated against its magnets"
    equation = "y_zeta = cos(a) true y_zeta + sin(a) true y_eta, y_eta = cos(a) true y_eta - sin(a) true y_zeta"
    signature = "zeta answers eta with opposite sign to eta answering zeta, in y of one bearing"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"
    across_planes = True

    def why_not(self, rig: Rig) -> str:
        """Bearings of one axis."""
        return "" if of_two_axes(rig) else "no bearing has two axes"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Angle of each bearing's sensors [rad], counted from zeta to eta."""
        meaning = "angle a from magnets to sensors, from zeta to eta, of bearing"
        return [
            EffectParameter(f"angle_{b.name}", "rad", 0.01, lower=-0.8, upper=0.8, meaning=f"{meaning} {b.name}")
            for b in of_two_axes(rig)
        ]

    def attach(self, plant: Plant) -> None:
        """Exact to third order in the angle."""
        for bearing in of_two_axes(plant.rig):
            zeta, eta = (f"turned.{axis}" for axis in bearing.axis_names)
            slot = self.slot(f"angle_{bearing.name}")
            for own, other, sign in ((zeta, eta, 1.0), (eta, zeta, -1.0)):
                plant.inject(own, plant.port(slot, plant.raw(other), scale=sign))
                plant.inject(own, plant.port(slot, plant.raw(own), power=2, scale=-1.0 / 2.0))
                plant.inject(own, plant.port(slot, plant.raw(other), power=3, scale=-sign / 6.0))


@dataclass(frozen=True)
class SensorPositionError(Effect):
    """Sensors that sit elsewhere along the shaft than the rig file says."""

    name = "sensor_position_error"
    physics = "the sensors of a bearing read the rotor at another z than the rig file says"
    equation = "y = shape(z + dz) eta"
    signature = "rigid-body modes seen in other proportions at one bearing, both planes alike"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 12"

    def why_not(self, rig: Rig) -> str:
        """A mass on one axis, or a rotor whose shapes are not known beside the sensors."""
        point = "a point mass is the same wherever it is read"
        return point if isinstance(rig.rotor, PointMassRotor) else super().why_not(rig)

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Offset of each bearing's sensors [m]."""
        if isinstance(rig.rotor, PointMassRotor):
            return []
        meaning = "offset dz of the sensors along the shaft, of bearing"
        return [
            EffectParameter(f"offset_{b.name}", "m", 1e-3, lower=-0.05, upper=0.05, meaning=f"{meaning} {b.name}")
            for b in rig.bearings
        ]

    def positions(self, rig: Rig) -> Sequence[float]:
        """Some about every sensor, between which the shapes are known."""
        return about(rig, [b.sensor_position for b in rig.bearings])

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Another gain for every shape of the rotor."""
        return {GAIN_OF_READING: float("nan")}

    def attach(self, plant: Plant) -> None:
        """Exact to third order in the offset, as the shapes of beams are between nodes."""
        own = [b.sensor_position for b in plant.rig.bearings]
        eta = [plant[f"eta.{k}"] for k in range(plant.coordinates)]
        for bearing, axis, parts in moved_along(plant, own, self.positions(plant.rig)):
            for power, part in enumerate(parts, 1):
                moved = plant.port(self.slot(f"offset_{bearing.name}"), combine(part, eta), power=power)
                plant.inject(f"at_sensor.{axis}", moved)


@dataclass(frozen=True)
class SensorNonlinearity(Effect):
    """A reading that is bent: a sensor is linear near the middle of its range alone."""

    name = "sensor_nonlinearity"
    physics = "the displacement sensors are not linear over the motion, all alike"
    equation = "y = y_true + q y_true^2 + c y_true^3"
    signature = "even and odd harmonics in y that grow with its amplitude, and in i_c as the controller makes them of y"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 3"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Quadratic [1/m] and cubic [1/m^2] part, of which a hundredth at the gap is small."""
        gap = min(bearing.air_gap for bearing in rig.bearings)
        bend = "of the reading as a polynomial of the displacement"
        return [
            EffectParameter("quadratic", "1/m", 0.01 / gap, -10.0 / gap, 10.0 / gap, f"quadratic part q {bend}"),
            EffectParameter("cubic", "1/m^2", 0.01 / gap**2, -100.0 / gap**2, 100.0 / gap**2, f"cubic part c {bend}"),
        ]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Another curvature."""
        return {CURVATURE: float("nan")}

    def attach(self, plant: Plant) -> None:
        """At every sensor."""
        slots = {"c0": self.slot("quadratic"), "c1": self.slot("cubic")}
        for axis in plant.axes:
            bent = plant.block("polynomial", [plant.raw(f"scaled.{axis}")], slots, exponents=[[2], [3]])
            plant.inject(f"scaled.{axis}", bent)


@dataclass(frozen=True)
class SamplingSkew(Effect):
    """Currents and displacements read at different instants.

    Attributes
    ----------
    moves_y : bool
        Whether a digital controller, and the record, read y before the controller's output changes.
    """

    name = "sampling_skew"
    physics = "currents and displacements are not read at one instant, nor when a digital controller's output changes"
    equation = "i_c(t) = i_a(t + d), y(t) = y_true(t - e)"
    signature = "i_c alone is late, y fits; where the controller uses an early y, the loop loses damping as well"
    source = "Pintelon, Schoukens, System Identification, 2nd ed., section 2.7"

    moves_y: bool = False

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """i_c late alone; of a digital controller also y early, and that alone where the amplifier is ideal."""
        if seen.rig.amplifier.time_constant == 0.0:
            return (self,)
        return [SamplingSkew(moves_y) for moves_y in (False, True)[: 1 + seen.rig.controller.is_digital]]

    def why_not(self, rig: Rig) -> str:
        """Where i_c does not move between samples, and the controller's output has no instants either."""
        if rig.amplifier.time_constant > 0.0 or self._reads_y_early(rig):
            return ""
        return "an ideal amplifier holds i_c over the sample, and an analog controller has no instants"

    def _reads_y_early(self, rig: Rig) -> bool:
        return self.moves_y or (rig.controller.is_digital and rig.amplifier.time_constant == 0.0)

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """By how much i_c is read late, and y early [s]."""
        sample = 1.0 / rig.sample_rate
        reach, found = REACH * sample, []
        if rig.amplifier.time_constant > 0.0:
            probe, meaning = (
                min(0.02 * sample, 0.25 * rig.amplifier.time_constant),
                "by how much later than y i_c is read, d; negative where the record of i_c lags",
            )
            found.append(EffectParameter("current_late", "s", probe, lower=-reach, upper=reach, meaning=meaning))
        if self._reads_y_early(rig):
            meaning = "by how much y is read early, e"
            found.append(EffectParameter("displacement_early", "s", 0.02 * sample, upper=reach, meaning=meaning))
        return found

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """A late i_c, and an early y, which is a lag round the loop too."""
        late, early = values.get("current_late", 0.0), values.get("displacement_early", 0.0)
        lags = {LAG_OF_READING: early - late}
        return lags | {LAG_ROUND_LOOP: early} if self._reads_y_early(rig) else lags | {LAG_OF_CURRENT: late}

    def mended(self, record: Record, values: Mapping[str, float]) -> Record:
        """i_c moved to the instants of y, where y itself is not early."""
        late = values.get("current_late", 0.0) * record.sample_rate
        return record if self.moves_y else shifted(record, ("i_c",), late)

    def attach(self, plant: Plant) -> None:
        """Exact: from the instants at which y is read, commands come late by e, and i_c is read by d + e after them."""
        late, early = self.slot("current_late"), self.slot("displacement_early")
        reads_early = self._reads_y_early(plant.rig)
        if reads_early:
            plant.delay_commands(early)
        for axis in plant.axes:
            if plant.rig.amplifier.time_constant > 0.0:
                plant.record_late(f"i_c.{axis}", late, -1.0)
            if reads_early:
                plant.record_late(f"i_c.{axis}", early, -1.0)


EFFECTS = (
    SensorLag(),
    SensorGainError(),
    SensorMisalignment(),
    SensorPositionError(),
    SensorNonlinearity(),
    SamplingSkew(),
)
