"""The rig file: everything that is known about the machine before any record is read."""

import io
import os
import tomllib
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, ValidationError, ValidationInfo, field_validator

from ambid.channels import SIGNALS, Channel
from ambid.errors import RigError
from ambid.reading import Provenance, reading
from ambid.results import html_table
from ambid.rig.controller import SAMPLE_RATE, AnyController, Controller
from ambid.rig.fields import NOTHING, Range, Spec, problem, refuse, rig_error
from ambid.rig.magnets import Actuator, Amplifier, Bearing
from ambid.rig.parts import Sensor
from ambid.rig.rotor import PointMassRotor, Rotor, off_the_shaft
from ambid.rig.tolerance import MEASURED_FREQUENCY, TYPICAL, Tolerance
from ambid.rig.toml import toml_text
from ambid.writing import whole_file

MOST_BEARINGS = 8
"""Bearings of a rig: sixteen axes, whose loop has some hundred parameters and as many states as a fit can bear."""
SPEED = Range(0.0, 5e4, "rad/s")
LONGEST_FILE = 1 << 23
"""Characters of a rig file: three matrices of 200 freedoms take a third, and reading as much takes seconds."""
OUTPUTS = ("heard", "recorder")
"""Paths of the noise of what a machine gives."""


class Rig(Spec):
    """A machine: rotor, bearings, amplifiers and controller, in SI units.

    Parameters
    ----------
    name : str
        What results and reports call it.
    sample_rate : float
        Of every recorded channel [Hz].
    speed : float
        Of rotation [rad/s].
    rotor : FiniteElementRotor, MatrixRotor, ModalRotor or PointMassRotor
        By its dimensions, matrices, modes, or a plain mass.
    bearings : sequence of Bearing
        The magnets with their sensors, one or more; `bearing` in the file.
    amplifier : Amplifier
        Of every axis.
    actuator : Actuator
        Of every axis.
    controller : PidController, StateSpaceController or TransferFunctionController
        From the displacements to the commands of the amplifiers.
    sensors : sequence of Sensor, optional
        Beside those of the bearings; `sensor` in the file.
    tolerance : Tolerance, optional
        How well all these are known; without it, typical standard deviations are assumed.

    Raises
    ------
    RigError
        With one line per problem: key, value found, what is allowed, what to do.
    """

    name: str = Field(description="a text, the name of the rig")
    sample_rate: Annotated[float, SAMPLE_RATE]
    speed: Annotated[float, SPEED] = 0.0
    rotor: Rotor = Field(description="a table [rotor] with its sections, matrices, modes or mass")
    bearings: tuple[Bearing, ...] = Field(
        alias="bearing",
        min_length=1,
        max_length=MOST_BEARINGS,
        description=f"1 to {MOST_BEARINGS} [[bearing]] tables, each with double brackets",
    )
    amplifier: Amplifier = Field(description="a table [amplifier] with time_constant in s")
    actuator: Actuator = Field(description="a table [actuator] with time_constant in s")
    controller: AnyController = Field(
        description="a table [controller] with kind = 'pid', 'state_space' or 'transfer_function'"
    )
    sensors: tuple[Sensor, ...] = Field(
        (), alias="sensor", max_length=32, description="[[sensor]] tables, each with double brackets"
    )
    tolerance: Tolerance = Field(
        Tolerance(exact=False), description="a table [tolerance] with standard deviations, or exact = true"
    )
    _path: Path | None = PrivateAttr(None)
    _provenance: Provenance | None = PrivateAttr(None)

    @field_validator("bearings")
    @classmethod
    def _bearings_fit(cls, bearings: tuple[Bearing, ...], info: ValidationInfo) -> tuple[Bearing, ...]:
        names = [bearing.name for bearing in bearings]
        problems = [
            problem("expected a name of its own, another bearing has this one; rename one of them.", name, k, "name")
            for k, name in enumerate(names)
            if name in names[:k]
        ]
        rotor = info.data.get("rotor")
        if isinstance(rotor, PointMassRotor):
            axes = [axis for bearing in bearings for axis in bearing.axis_names]
            if len(axes) != 1:
                text = "expected 1 axis, since the rotor is a plain mass; write one [[bearing]] with axes = ['zeta']."
                problems.append(problem(text, axes, "axes"))
        elif rotor is not None:
            problems += [
                problem(complaint, getattr(bearing, key), k, key)
                for k, bearing in enumerate(bearings)
                for key in ("position", "sensor_position")
                if (complaint := off_the_shaft(rotor.span, getattr(bearing, key)))
            ]
        refuse(*problems)
        return bearings

    @field_validator("controller")
    @classmethod
    def _controller_fits(cls, controller: Controller, info: ValidationInfo) -> Controller:
        if "bearings" in info.data and "sample_rate" in info.data:
            n_axes = sum(len(bearing.axes) for bearing in info.data["bearings"])
            refuse(*controller.rig_problems(n_axes, info.data["sample_rate"]))
        amplifier = info.data.get("amplifier")
        if "i_c" in controller.signals and amplifier is not None and amplifier.time_constant == 0.0:
            text = "reads i_c, which follows the command at once where amplifier.time_constant = 0; give the lag [s]."
            refuse(problem(text, controller.signals, "inputs"))
        return controller

    @field_validator("sensors")
    @classmethod
    def _sensors_fit(cls, sensors: tuple[Sensor, ...], info: ValidationInfo) -> tuple[Sensor, ...]:
        names = [sensor.name for sensor in sensors]
        axes = [axis for bearing in info.data.get("bearings", ()) for axis in bearing.axis_names]
        text = "expected a name of its own, {} has this one; rename one of them."
        problems = [
            problem(text.format("an axis" if name in axes else "another sensor"), name, k, "name")
            for k, name in enumerate(names)
            if name in axes or name in names[:k]
        ]
        if "bearings" in info.data:
            bearings = [bearing.name for bearing in info.data["bearings"]]
            text = f"expected the name of a bearing, {', '.join(bearings)}; correct it, or leave it out on the rotor."
            problems += [
                problem(text, own.housing, k, "housing")
                for k, own in enumerate(sensors)
                if own.housing is not None and own.housing not in bearings
            ]
        rotor = info.data.get("rotor")
        if rotor is not None and rotor.span is not None:
            required = "expected the sensor's place on the shaft; add it, in m."
            problems += [
                problem(complaint, NOTHING if own.position is None else own.position, k, "position")
                for k, own in enumerate(sensors)
                if own.housing is None
                and (complaint := required if own.position is None else off_the_shaft(rotor.span, own.position))
            ]
        refuse(*problems)
        return sensors

    @property
    def path(self) -> Path | None:
        """The file that it was read from, if any; no part of its equality."""
        return self._path

    @property
    def provenance(self) -> Provenance | None:
        """Size and hash of what was read of that file."""
        return self._provenance

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of all axes in order, such as ("A_zeta", "A_eta", "B_zeta", "B_eta")."""
        return tuple(axis for bearing in self.bearings for axis in bearing.axis_names)

    @property
    def force_per_flux(self) -> dict[str, float]:
        """`Bearing.force_per_flux` of each axis where it is known."""
        known = [(b.axis_names, own) for b in self.bearings if (own := b.force_per_flux) is not None]
        return {axis: gain for axes, own in known for axis, gain in zip(axes, own, strict=True)}

    @property
    def outputs(self) -> tuple[str, ...]:
        """Every channel that a record of the machine may hold as an output of the loop, y and i_c first."""
        of_axes = [f"{name}.{axis}" for name, own in SIGNALS.items() if own.path in OUTPUTS for axis in self.axes]
        return (*(name for name in of_axes if not self.lacks(name)), *(sensor.channel for sensor in self.sensors))

    @property
    def instrumented(self) -> tuple[str, ...]:
        """Of `outputs`, those that keys of the file are there for: flux densities, voltages of coils, sensors."""
        coils = self.axes if self.amplifier.coil_resistance is not None else ()
        of_axes = [f"{name}.{axis}" for name, axes in (("b", self.force_per_flux), ("u", coils)) for axis in axes]
        return (*of_axes, *(sensor.channel for sensor in self.sensors))

    def lacks(self, channel: str) -> str:
        """Why no such output is known of the machine, and what to add to the rig file; empty where it is."""
        own = Channel.of(channel)
        if own is None or own.signal.path not in OUTPUTS:
            return f"it is no output; expected {', '.join(n for n, s in SIGNALS.items() if s.path in OUTPUTS)}"
        at_sensors = [sensor.name for sensor in self.sensors if sensor.signal == own.signal.name]
        if own.place in at_sensors:
            return ""
        if "axis" not in own.signal.at or own.place not in self.axes:
            places = [*(self.axes if "axis" in own.signal.at else ()), *at_sensors]
            hint = f", or add a [[sensor]] with signal = '{own.signal.name}' and name = '{own.place}'"
            known = f"the rig has {own.signal.name} of {', '.join(places) or 'nothing'}; rename it"
            return known + hint if "sensor" in own.signal.at else known
        if own.signal.name == "b" and own.place not in self.force_per_flux:
            return f"add pole_area [m^2] or bias_flux [T] to the bearing of {own.place}"
        if own.signal.name == "u" and self.amplifier.resistance is None and self.amplifier.coil_resistance is None:
            return (
                "add amplifier.coil_resistance and coil_inductance, or amplifier.resistance of a coil whose voltage is "
                "commanded"
            )
        return ""

    def known_to(self, key: str) -> float:
        """Standard deviation to which a value is known, see `Tolerance`: the stated one, or what is typical here."""
        stated = self.tolerance.stated(key)
        if stated is not None:
            return stated
        if self.controller.is_digital and key in ("controller_gain", "excitation_gain"):
            return 0.0
        if key == "bending_frequency" and getattr(self.rotor, "bending_frequencies_hz", None):
            return MEASURED_FREQUENCY
        return TYPICAL[key]

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Rig":
        """Read a rig file.

        Parameters
        ----------
        path : path-like
            A TOML file in SI units; see `Rig` for its tables.

        Raises
        ------
        RigError
            If the file cannot be read, is not TOML, or holds a wrong key or value.
        """
        try:
            with Path(path).open("rb") as file:
                content = file.read(4 * (LONGEST_FILE + 1))  # a character of UTF-8 has four bytes at most
            text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8").read(LONGEST_FILE + 1)
        except FileNotFoundError:
            raise RigError(f"{path}: there is no such file; check the path of the rig file.") from None
        except OSError as error:
            raise RigError(f"{path}: cannot be read ({error.strerror}); give the path of a rig file.") from None
        except UnicodeDecodeError as error:
            raise RigError(f"{path}: not a text in UTF-8 ({error.reason}); give a rig file in TOML.") from None
        if len(text) > LONGEST_FILE:
            raise RigError(f"{path}: more than {LONGEST_FILE} characters; give a rig file, large matrices by `file`.")
        rig = cls.from_toml(text, path)
        rig._provenance = Provenance.of(content)
        return rig

    @classmethod
    def from_toml(cls, text: str, path: str | os.PathLike[str] | None = None) -> "Rig":
        """Read a rig from the text of a rig file.

        Parameters
        ----------
        text : str
        path : path-like, optional
            Where the text is from, for messages and for files that it names.

        Raises
        ------
        RigError
            If the text is not TOML, or holds a wrong key or value.
        """
        source = "rig" if path is None else os.fspath(path)
        with reading(source, RigError, "a rig", "correct it there"):
            try:
                data = tomllib.loads(text)
            except tomllib.TOMLDecodeError as error:
                raise RigError(f"{source}: not a TOML file: {error}; correct it there.") from None
            try:
                rig = cls.model_validate(data, context={"directory": Path(source).parent})
            except ValidationError as error:
                raise rig_error(error, source, data) from None
        rig._path = None if path is None else Path(path)
        return rig

    def to_toml(self) -> str:
        """Write the rig as the text of a rig file; `Rig.from_toml` reads the same rig back, to the last bit."""
        return toml_text(self.model_dump(by_alias=True, exclude_none=True))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rig file that `Rig.load` reads back.

        Raises
        ------
        InputError, OutputError
            If it cannot be written there.
        """
        with whole_file(Path(path)) as stream:
            stream.write(self.to_toml().encode())

    def replace(self, **changes: Any) -> "Rig":
        """Return a rig with other values of some keys, checked as a new one.

        Raises
        ------
        RigError
            If a key is unknown, or the rig would be wrong.
        """
        rig = type(self)(**{key: getattr(self, key) for key in type(self).model_fields} | changes)
        rig._path, rig._provenance = self._path, self._provenance
        return rig

    @property
    def is_exact(self) -> bool:
        """Whether its [tolerance] says that every value is exact."""
        return self.tolerance.exact

    def exact(self) -> "Rig":
        """Return the rig with every value taken for exact, whatever its [tolerance] says."""
        return self if self.is_exact else self.replace(tolerance={"exact": True})

    def __repr__(self) -> str:
        controller = f"{self.controller.implementation} {self.controller.kind}"  # type: ignore[attr-defined]
        return (
            f"Rig({self.name!r}: axes {', '.join(self.axes)}; {self.sample_rate:g} Hz, {self.speed:g} rad/s; "
            f"rotor by {self.rotor.kind}, {controller} controller)"
        )

    __str__ = __repr__

    def _repr_html_(self) -> str:
        head = ["bearing", "axes", "position", "sensor_position", "tilt", "bias_current", "air_gap"]
        rows = [
            [b.name, ", ".join(b.axes), b.position, b.sensor_position, b.tilt, b.bias_current, b.air_gap, k_i, k_s]
            for b in self.bearings
            for k_i, k_s in [(", ".join(f"{v:g}" for v in own) for own in (b.force_current, b.force_displacement))]
        ]
        return html_table([*head, "force_current", "force_displacement"], rows, [repr(self)])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rig) and self._values() == other._values()

    def __hash__(self) -> int:
        return self._own_hash

    @cached_property
    def _own_hash(self) -> int:
        return hash(self._values())

    def _values(self) -> tuple[Any, ...]:
        return tuple(getattr(self, key) for key in type(self).model_fields)


def as_rig(given: Rig | str | Path) -> Rig:
    """The rig itself, or the one in a file.

    Raises
    ------
    RigError
        If it is neither, or the file is none.
    """
    if isinstance(given, Rig):
        return given
    if isinstance(given, str | Path):
        return Rig.load(given)
    raise RigError(f"rig: {type(given).__name__} given; expected a Rig, or the path of a rig file")
