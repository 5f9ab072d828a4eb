"""Bearings, amplifiers and actuators of a rig file: what makes current of a command, and force of current."""

import math
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from ambid.rig.fields import (
    MICROMETRES,
    MICROSECONDS,
    MILLIMETRES,
    MILLISECONDS,
    NOTHING,
    Range,
    Spec,
    per_axis,
    plain,
    problem,
    refuse,
)
from ambid.rig.parts import DIRECTION, Position

POLE_AREA = Range(1e-7, 1.0, "m^2", (("mm^2", 1e-6), ("cm^2", 1e-4)))
BIAS_FLUX = Range(1e-3, 2.4, "T", (("mT", 1e-3), ("gauss", 1e-4)), "iron saturates below 2.4 T")
MU_0 = 4e-7 * math.pi
"""Permeability of air [V s/(A m)]."""
_CONVENTION = "f = K_i i + K_s s"
FORCE_CURRENT = Range(1e-4, 1e5, "N/A", (), f"{_CONVENTION}, K_i > 0: current pulls towards +s")
FORCE_DISPLACEMENT = Range(-1e10, 1e10, "N/m", (), f"{_CONVENTION}, K_s > 0 destabilises")
LEAST_STIFFNESS = 1e-2
"""Smallest size of K_s [N/m]; a magnet has some, and parameters are scaled by it."""
STIFFNESS_SLIPS = (("N/mm", 1e3), ("N/um", 1e6))
SLIPPED = 5.0
"""Factor within which K_s in another unit is that of a magnet: then the unit is wrong, and not the machine another."""
SHORTEST_LAG = 1e-7
"""Seconds: a lag of a tenth of the shortest sample is none."""
AMPLIFIER_LAG = Range(0.0, 0.05, "s", (MILLISECONDS, MICROSECONDS), "0 is an ideal amplifier", SHORTEST_LAG)
ACTUATOR_LAG = Range(SHORTEST_LAG, 0.05, "s", (MILLISECONDS, MICROSECONDS))
RESISTANCE = Range(1e-3, 1e5, "ohm", (("kilohm", 1e3),), "of a coil whose voltage is commanded")
COIL_RESISTANCE = Range(1e-3, 1e5, "ohm", (("kilohm", 1e3),), "of both opposed coils together")
COIL_INDUCTANCE = Range(1e-7, 1e3, "H", (("mH", 1e-3), ("uH", 1e-6)), "of both opposed coils together")


class Bearing(Spec):
    """One magnetic bearing with its sensors. Sign convention: f = K_i i + K_s s, K_s > 0 destabilises.

    Parameters
    ----------
    name : str
        An identifier without dots; it begins the names of the axes.
    position : float
        z of the magnet [m].
    sensor_position : float
        z of the sensors [m].
    tilt : float
        From global x to the zeta axis [degrees]; the sensors are aligned with the magnet.
    bias_current : float
        i0 [A].
    air_gap : float
        s0 [m], between magnet and rotor in the centre.
    axes : ("zeta", "eta") or ("zeta",)
        Directions in which it acts.
    force_current : float or sequence of float
        Nominal K_i of each axis [N/A]; a number stands for all. Kept as one value per axis.
    force_displacement : float or sequence of float
        Nominal K_s of each axis [N/m]; a number stands for all. Kept as one value per axis. Negative of passive or
        repelling magnets, which centre the rotor.
    pole_area : float, optional
        A of one pole [m^2], of a bearing with Hall sensors in the gap.
    bias_flux : float or sequence of float, optional
        B_0 of each axis [T], flux density in the gap with the rotor in the centre; a number stands for all. Either of
        both keys is enough, see `force_per_flux`.
    """

    name: str = Field(description="a name such as A: letters, digits and _, no dots")
    axes: tuple[Literal["zeta", "eta"], ...] = Field(
        ("zeta", "eta"),
        description=(
            "['zeta', 'eta'], or ['zeta'] for a single axis, both across the shaft; along it a rotor is a plain mass, "
            "and a thrust bearing has a rig file of its own"
        ),
    )
    position: Position
    sensor_position: Position
    tilt: Annotated[float, DIRECTION] = 0.0
    bias_current: Annotated[float, Range(1e-3, 500.0, "A", (("milliamperes", 1e-3),))]
    air_gap: Annotated[float, Range(1e-5, 0.1, "m", (MILLIMETRES, MICROMETRES))]
    force_current: Annotated[tuple[float, ...], per_axis(FORCE_CURRENT)] = Field(
        description=f"K_i, {FORCE_CURRENT.allowed}, a number or one per axis"
    )
    force_displacement: Annotated[tuple[float, ...], per_axis(FORCE_DISPLACEMENT)] = Field(
        description=f"K_s, {FORCE_DISPLACEMENT.allowed}, a number or one per axis"
    )
    pole_area: Annotated[float, POLE_AREA] | None = Field(None, description=f"area of a pole, {POLE_AREA.allowed}")
    bias_flux: Annotated[tuple[float, ...], per_axis(BIAS_FLUX)] | None = Field(
        None, description=f"B_0, {BIAS_FLUX.allowed}, a number or one per axis"
    )

    @field_validator("name")
    @classmethod
    def _identifier(cls, name: str) -> str:
        if not name.isidentifier():
            refuse(problem("expected a name such as A: letters, digits and _, no dots, no spaces.", name))
        return name

    @field_validator("axes")
    @classmethod
    def _known_axes(cls, axes: tuple[str, ...]) -> tuple[str, ...]:
        if axes not in (("zeta", "eta"), ("zeta",)):
            refuse(problem("expected ['zeta', 'eta'], or ['zeta'] for a single axis.", axes))
        return axes

    @field_validator("force_current", "force_displacement", "bias_flux")
    @classmethod
    def _each_axis(cls, value: float | tuple[float, ...] | None, info: ValidationInfo) -> tuple[float, ...] | None:
        if value is None:
            return None
        n_axes = len(info.data.get("axes", ("zeta", "eta")))
        values = value if isinstance(value, tuple) else (value,) * n_axes
        if len(values) != n_axes:
            refuse(problem(f"expected a number, or {n_axes} numbers, one per axis; found {len(values)}.", values))
        return values

    @field_validator("force_displacement")
    @classmethod
    def _some_stiffness(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        text = (
            f"expected at least {LEAST_STIFFNESS:g} N/m in size ({FORCE_DISPLACEMENT.note}), as identification keeps "
            f"its sign; an actuator without magnetic stiffness has {-LEAST_STIFFNESS:g}, held there by --fix K_s."
        )
        refuse(*(problem(text, value, k) for k, value in enumerate(values) if abs(value) < LEAST_STIFFNESS))
        return values

    @model_validator(mode="after")
    def _stiffness_fits_the_magnet(self) -> "Bearing":
        """K_s s0 / (K_i i0) is 1 for a differential pair of magnets; where a unit mends it, that is wrong.

        A drive without a bias has next to no K_s; `check` reports what is far from a magnet's.
        """
        for k_i, k_s in zip(self.force_current, self.force_displacement, strict=True):
            ideal = k_i * self.bias_current / self.air_gap
            note = f"0.01 to 100 times K_i bias_current / air_gap = {plain(ideal)} N/m"
            complaint = Range(0.01 * ideal, 100.0 * ideal, "N/m", STIFFNESS_SLIPS, note).complaint(k_s)
            if complaint and any(1.0 / SLIPPED < factor * k_s / ideal < SLIPPED for _, factor in STIFFNESS_SLIPS):
                refuse(problem(complaint, k_s, "force_displacement"))
        return self

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of its axes in records and results, such as ("A_zeta", "A_eta")."""
        return tuple(f"{self.name}_{axis}" for axis in self.axes)

    @property
    def force_per_flux(self) -> tuple[float, ...] | None:
        """Force of each axis by the difference b of the flux densities of opposed poles [N/T]; None if not known.

        Two poles a side pull with A B^2/mu_0, so that about the bias f = 2 A B_0 b/mu_0; and from b = 2 B_0 i/i_0 of
        the same pair K_i = 4 A B_0^2/(mu_0 i_0), which gives A or B_0 where one is not stated (Schweitzer, Maslen
        (eds.), Magnetic Bearings, 2009, section 4.1).
        """
        area, flux, i_0 = self.pole_area, self.bias_flux, self.bias_current
        if area is not None:
            own = flux or (math.sqrt(MU_0 * k_i * i_0 / (4.0 * area)) for k_i in self.force_current)
            return tuple(2.0 * area * b_0 / MU_0 for b_0 in own)
        if flux is not None:
            return tuple(k_i * i_0 / (2.0 * b_0) for k_i, b_0 in zip(self.force_current, flux, strict=True))
        return None


class Amplifier(Spec):
    """Power amplifier or voltage-driven coil.

    Parameters
    ----------
    time_constant : float
        Of its known first-order lag [s]. Of a voltage-driven coil L/R.
    resistance : float, optional
        Nominal R [ohm] of a coil whose voltage the controller commands: then K is in V/m, i_ref and i_e are in V, and
        R of every axis is a parameter. Leave it out where current is commanded.
    coil_resistance, coil_inductance : float, optional
        R [ohm] and L [H] of both opposed coils of an axis together, where current is commanded: they give the voltage
        ``u = u_+ - u_- = R i + L di/dt + K_i v`` that records may hold.
    """

    time_constant: Annotated[float, AMPLIFIER_LAG]
    resistance: Annotated[float, RESISTANCE] | None = None
    coil_resistance: Annotated[float, COIL_RESISTANCE] | None = None
    coil_inductance: Annotated[float, COIL_INDUCTANCE] | None = None

    @model_validator(mode="after")
    def _coil_fits(self) -> "Amplifier":
        if (self.coil_resistance is None) != (self.coil_inductance is None):
            missing = "coil_inductance" if self.coil_inductance is None else "coil_resistance"
            refuse(problem("is missing: the voltage of a coil takes both; add it.", NOTHING, missing))
        if self.coil_resistance is not None and self.resistance is not None:
            why = "not allowed with resistance, of a coil whose voltage is commanded; remove one of them."
            refuse(problem(why, self.coil_resistance, "coil_resistance"))
        if self.coil_resistance is not None and self.time_constant == 0.0:
            why = "not allowed with time_constant = 0: a current that jumps takes an infinite voltage; give the lag."
            refuse(problem(why, self.coil_resistance, "coil_resistance"))
        return self

    @property
    def command_unit(self) -> str:
        """Unit of i_ref and i_e."""
        return "A" if self.resistance is None else "V"


class Actuator(Spec):
    """First-order lag from coil current to force.

    Parameters
    ----------
    time_constant : float
        Initial guess of tau_e [s].
    has_lag : bool
        False where force follows current at once: then there is no tau_e, and no `time_constant` is given.
    """

    has_lag: bool = Field(True, strict=True, description="true or false, without quotes")
    time_constant: Annotated[float, ACTUATOR_LAG] | None = Field(None, description="a number in s, the guess of tau_e")

    @model_validator(mode="after")
    def _lag_or_none(self) -> "Actuator":
        if self.has_lag and self.time_constant is None:
            refuse(problem(f"expected {ACTUATOR_LAG.allowed}; or write has_lag = false.", NOTHING, "time_constant"))
        if not self.has_lag and self.time_constant is not None:
            refuse(
                problem("not allowed with has_lag = false; remove one of them.", self.time_constant, "time_constant")
            )
        return self
