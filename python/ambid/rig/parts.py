"""What a rotor is made of and held by: sections of a shaft, disks, and known springs and dampers to ground."""

from collections.abc import Sequence
from typing import Annotated, Any, get_args

import numpy as np
from pydantic import Field, field_validator, model_validator
from pydantic_core import InitErrorDetails

from ambid.channels import SIGNALS, SensorSignal
from ambid.rig.fields import MILLIMETRES, Range, Spec, plain, problem, refuse

Position = Annotated[float, Range(unit="m")]

OUTER_DIAMETER = Range(1e-4, 3.0, "m", (MILLIMETRES,))
MASS = Range(1e-6, 1e5, "kg")
INERTIA = Range(0.0, 1e5, "kg m^2", (("kg mm^2", 1e-6),))
DIRECTION = Range(-360.0, 360.0, "degrees")


class Material(Spec):
    """Isotropic material.

    Parameters
    ----------
    density : float
        Mass per volume [kg/m^3].
    youngs_modulus : float
        Stress per strain [Pa]; scales all bending frequencies.
    poisson_ratio : float
        Shares out shear and bending in short sections.
    """

    density: Annotated[float, Range(500.0, 23000.0, "kg/m^3", (("g/cm^3", 1e3),))]
    youngs_modulus: Annotated[float, Range(1e9, 2e12, "Pa", (("GPa", 1e9), ("MPa", 1e6)))]
    poisson_ratio: Annotated[float, Range(0.0, 0.5)]


class Section(Spec):
    """Cylindrical or conical piece of shaft; the sections lie end to end from z = 0 on.

    Parameters
    ----------
    length : float
        Along z [m].
    outer_diameter : float
        Of the cylinder, or of a cone where it begins [m].
    outer_diameter_end : float, optional
        Of a cone where it ends [m]; between them the diameter changes in proportion to z. A cylinder if left out.
    inner_diameter : float
        Of a hollow shaft [m], less than the outer one.
    material : Material, optional
        Of this section; that of the rotor if left out.
    """

    length: Annotated[float, Range(1e-5, 5.0, "m", (MILLIMETRES,))]
    outer_diameter: Annotated[float, OUTER_DIAMETER]
    outer_diameter_end: Annotated[float, OUTER_DIAMETER] | None = None
    inner_diameter: Annotated[float, Range(0.0, 3.0, "m", (MILLIMETRES,))] = 0.0
    material: Material | None = Field(None, description="a table with density, youngs_modulus, poisson_ratio")

    @model_validator(mode="after")
    def _hollow_inside(self) -> "Section":
        outer = {"outer_diameter": self.outer_diameter, "outer_diameter_end": self.outer_diameter_end}
        key, least = min(((key, own) for key, own in outer.items() if own is not None), key=lambda own: own[1])
        if self.inner_diameter >= least:
            allowed = f"expected less than {key} = {least:g} m; write 0 for a solid shaft."
            refuse(problem(allowed, self.inner_diameter, "inner_diameter"))
        return self


class Disk(Spec):
    """Rigid body on the shaft.

    Parameters
    ----------
    position : float
        z of its centre [m].
    mass : float
        Of the disk alone [kg].
    transverse_inertia : float
        About a diameter through its own centre [kg m^2].
    polar_inertia : float
        About the axis of the shaft [kg m^2]; brings gyroscopic moments where the rotor turns.
    """

    position: Position
    mass: Annotated[float, MASS]
    transverse_inertia: Annotated[float, INERTIA]
    polar_inertia: Annotated[float, INERTIA]

    @model_validator(mode="after")
    def _of_a_body(self) -> "Disk":
        refuse(*too_polar_disk(self.transverse_inertia, self.polar_inertia))
        return self


class Support(Spec):
    """Spring and damper from the rotor to ground at one place, alike in every direction: F = -K u - C u'.

    Parameters
    ----------
    position : float, optional
        z [m]; a plain mass has no places.
    stiffness : float
        K [N/m]; negative where it pulls the rotor away from the centre, as permanent magnets do.
    damping : float
        C [N s/m].
    """

    position: Position | None = None
    stiffness: Annotated[float, Range(-1e10, 1e10, "N/m", (), "K > 0 centres")] = 0.0
    damping: Annotated[float, Range(0.0, 1e8, "N s/m")] = 0.0

    @property
    def z(self) -> float:
        """The position [m]; 0 of a plain mass, which moves alike wherever it is asked."""
        return self.position or 0.0


class Sensor(Spec):
    """A sensor beside those of the bearings, which the controller does not read; its channel is ``<signal>.<name>``.

    Parameters
    ----------
    signal : str
        What it reads: acceleration `a` [m/s^2], or displacement `y` [m], of the rotor.
    name : str
        An identifier without dots, none of an axis.
    position : float, optional
        z [m]; a plain mass has no places.
    direction : float
        In which it reads, from global x to y [degrees]; a plain mass has none.
    housing : str, optional
        Name of the bearing on whose housing it sits; then it reads the motion of that, and has no position.
    """

    signal: SensorSignal = Field(
        description=" or ".join(f"'{name}' ({SIGNALS[name].meaning})" for name in get_args(SensorSignal))
    )
    name: str = Field(description="a name such as drive_end: letters, digits and _, no dots")
    position: Position | None = None
    direction: Annotated[float, DIRECTION] = 0.0
    housing: str | None = Field(None, description="the name of a bearing")

    @field_validator("name")
    @classmethod
    def _identifier(cls, name: str) -> str:
        if not name.isidentifier():
            refuse(problem("expected a name such as drive_end: letters, digits and _, no dots, no spaces.", name))
        return name

    @property
    def channel(self) -> str:
        """Of records, such as ``a.drive_end``."""
        return f"{self.signal}.{self.name}"

    @property
    def z(self) -> float:
        """The position [m]; 0 of a plain mass, which moves alike wherever it is asked."""
        return self.position or 0.0


MOST_POLAR = 2.02
"""Polar inertia of a body over its transverse one: 2 of a thin disk, and what rounding adds."""


def too_polar_disk(transverse: float, polar: float) -> list[InitErrorDetails]:
    """Problem of a disk with these inertias [kg m^2]; none where a body has them."""
    if polar <= MOST_POLAR * transverse:
        return []
    text = (
        f"expected at most {plain(2.0 * transverse)} kg m^2, twice transverse_inertia: no body has more, and a thin "
        "disk has as much; are the two exchanged, or is one in another unit?"
    )
    return [problem(text, polar, "polar_inertia")]


def polar_over_transverse(
    M: Sequence[Sequence[float]], G: Sequence[Sequence[float]], node_positions: Sequence[float]
) -> float:
    """Polar inertia of a whole rotor by G over its transverse one about the centre of mass by M."""
    mass, z = np.array(M), np.array(node_positions)
    ones, none = np.ones_like(z), np.zeros_like(z)
    shift = np.column_stack([ones, none, none, none]).ravel()
    centre = float(shift @ mass @ np.column_stack([z, none, none, ones]).ravel() / (shift @ mass @ shift))
    in_x = np.column_stack([z - centre, none, none, ones]).ravel()
    in_y = np.column_stack([none, z - centre, -ones, none]).ravel()
    return float(abs(in_y @ np.array(G) @ in_x) / (in_x @ mass @ in_x))


def too_polar(ratio: float, value: Any, key: str) -> list[InitErrorDetails]:
    """Problem of a rotor that as a rigid body has a larger polar inertia than any body; none where it has not."""
    if ratio <= MOST_POLAR:
        return []
    text = (
        f"its polar inertia is {plain(ratio)} times the transverse one of the whole rotor, expected at most 2: no body "
        "has more; is it multiplied by the speed already? Here speed [rad/s] multiplies it."
    )
    return [problem(text, value, key)]
