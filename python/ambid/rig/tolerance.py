"""How well the values of a rig file are known: standard deviations, typical ones where the file states none.

Each typical value is a type B evaluation in the sense of the GUM (JCGM 100:2008, 4.3): from data sheets and general
knowledge of the instrument, not from repeated observation.
"""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from ambid.rig.fields import MICROMETRES, MICROSECONDS, MILLIMETRES, MILLISECONDS, Range, Spec

PART = Range(0.0, 1.0, "", (("percent", 0.01),), "relative, one standard deviation; 0 is exact")
LENGTH = Range(0.0, 0.1, "m", (MILLIMETRES, MICROMETRES), "one standard deviation; 0 is exact", 1e-9)
ANGLE = Range(0.0, 45.0, "degrees", (), "one standard deviation; 0 is exact", 1e-6)
TIME = Range(0.0, 1e-2, "s", (MILLISECONDS, MICROSECONDS), "one standard deviation; 0 is exact", 1e-12)

_KNOWN: Mapping[str, tuple[float, str]] = {
    "mass": (
        0.005,
        "finite elements of a turned shaft: density of steel 0.3 %, diameters and lengths 0.1 % each; weighing is "
        "better. Friswell et al., Dynamics of Rotating Machines, 2010, chapter 5",
    ),
    "inertia": (0.01, "as the mass, with the places of disks"),
    "position": (5e-4, "drawing tolerance and thermal growth of a housing, ISO 2768-m: 0.5 mm from 120 to 400 mm"),
    "sensor_position": (5e-4, "as the position; the centre of a coil is not that of its case"),
    "sensor_angle": (0.5, "drilled bracket, ISO 2768-m: 30 minutes of arc"),
    "sensor_gain": (
        0.01,
        "eddy-current sensors calibrated on the shaft's own material: linearity and sensitivity 1 %; uncalibrated 5 "
        "%, API 670",
    ),
    "current_gain": (0.005, "closed-loop Hall transducers and shunts with their amplifiers: 0.5 %"),
    "excitation_gain": (
        0.002,
        "gain error of digital-to-analog converters and summing resistors: 0.2 %; none where a digital controller "
        "adds the excitation as a number",
    ),
    "instant": (1e-6, "skew between simultaneously sampling channels with like filters: 1 us"),
    "bending_frequency": (
        0.01,
        "finite elements with shrink fits: 1 %; 0.2 % where bending_frequencies_hz were measured",
    ),
    "modal_damping": (0.5, "of fits and materials, known by its order of magnitude; half of itself"),
    "amplifier_time_constant": (0.05, "inductance and gain of a current loop: 5 %"),
    "controller_gain": (0.01, "resistors and capacitors of 1 %; none of a digital controller"),
    "bias_current": (0.01, "as the current reading, with its drift: 1 %"),
    "air_gap": (0.05, "stacking of laminations and run-out of the journal: 5 %"),
    "flux_gain": (
        0.05,
        "force by the flux density b: Hall element 2 %, its place under the pole, area and bias flux of that, or "
        "K_i where one of both is not given: 5 %",
    ),
    "voltage_gain": (0.01, "divider of resistors of 1 %"),
    "coil_resistance": (0.1, "copper, 0.39 % per kelvin, at a temperature that is known to 25 K: 10 %"),
    "coil_inductance": (0.2, "air gap as above, fringing and leakage, and the iron's share of the reluctance: 20 %"),
    "force_gain": (0.01, "load cell under the stator with its amplifier, calibrated in place: 1 %"),
    "acceleration_gain": (
        0.05,
        "nominal sensitivity of a piezoelectric accelerometer: 5 %; 1 % of one that is calibrated by ISO 16063-21",
    ),
}
TYPICAL: Mapping[str, float] = {key: own for key, (own, _) in _KNOWN.items()}
"""One standard deviation by key: absolute for places [m], angles [degrees] and instants [s], relative for the rest."""
SOURCES: Mapping[str, str] = {key: source for key, (_, source) in _KNOWN.items()}
"""Where each typical value is from."""

UNITS: Mapping[str, str] = {"position": "m", "sensor_position": "m", "sensor_angle": "degrees", "instant": "s"}
"""Of the keys that are absolute; the others are relative."""

MEASURED_FREQUENCY = 0.002
"""Relative, of a bending frequency that was measured: the resolution of an impact test, Ewins, Modal Testing, 2000."""


class Tolerance(Spec):
    """What is known of the rig file's values beside the values: one standard deviation each, Gaussian.

    Parameters
    ----------
    exact : bool
        Every value is exact, as in a simulation.
    mass, inertia, sensor_gain, current_gain, excitation_gain, bending_frequency, modal_damping : float, optional
    amplifier_time_constant, controller_gain, bias_current, air_gap : float, optional
    flux_gain, voltage_gain, force_gain, acceleration_gain, coil_resistance, coil_inductance : float, optional
        Relative.
    position, sensor_position : float, optional
        [m].
    sensor_angle : float, optional
        [degrees].
    instant : float, optional
        Of a channel's sampling [s].
    """

    exact: bool = Field(False, strict=True, description="true or false, without quotes")
    mass: Annotated[float, PART] | None = None
    inertia: Annotated[float, PART] | None = None
    position: Annotated[float, LENGTH] | None = None
    sensor_position: Annotated[float, LENGTH] | None = None
    sensor_angle: Annotated[float, ANGLE] | None = None
    sensor_gain: Annotated[float, PART] | None = None
    current_gain: Annotated[float, PART] | None = None
    excitation_gain: Annotated[float, PART] | None = None
    instant: Annotated[float, TIME] | None = None
    bending_frequency: Annotated[float, PART] | None = None
    modal_damping: Annotated[float, PART] | None = None
    amplifier_time_constant: Annotated[float, PART] | None = None
    controller_gain: Annotated[float, PART] | None = None
    bias_current: Annotated[float, PART] | None = None
    air_gap: Annotated[float, PART] | None = None
    flux_gain: Annotated[float, PART] | None = None
    voltage_gain: Annotated[float, PART] | None = None
    coil_resistance: Annotated[float, PART] | None = None
    coil_inductance: Annotated[float, PART] | None = None
    force_gain: Annotated[float, PART] | None = None
    acceleration_gain: Annotated[float, PART] | None = None

    @property
    def typical_keys(self) -> tuple[str, ...]:
        """Keys that the file leaves out, which have their typical value."""
        return () if self.exact else tuple(key for key in TYPICAL if getattr(self, key) is None)

    def stated(self, key: str) -> float | None:
        """The standard deviation that the file states; 0 where all is exact, None where it states none."""
        own: float | None = getattr(self, key)
        return 0.0 if self.exact else own
