"""The rotor as the rig file describes it: finite elements, matrices, measured or computed modes, or a plain mass."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, PrivateAttr, Tag, ValidationInfo, model_validator
from pydantic_core import InitErrorDetails

from ambid.findings import Finding
from ambid.rig.fields import MILLIMETRES, NOTHING, Range, Spec, per_axis, problem, refuse
from ambid.rig.parts import MASS, Disk, Material, Position, Section, Support, polar_over_transverse, too_polar
from ambid.rig.realisation import Matrix
from ambid.rig.rotor_files import MATRIX_KEYS, MOST_NODES, matrices_of_file

DAMPING = Range(0.0, 0.5, "", (("percent", 1e-2),), "a damping ratio")

SAME_PLACE = 1e-6
"""Axial positions closer than this [m] are one place."""
MOST_SECTIONS = 1000
"""Sections, or disks, of a rotor: its bending modes then take two seconds and half a gigabyte."""


class _AnyRotor(Spec):
    """What holds every rotor beside its magnets, as far as it is known."""

    mass_damping: Annotated[float, Range(0.0, 1e5, "1/s", (), "damping to ground over mass")] = 0.0
    # supports of a rotor; more are a bed, which mass_damping or the shaft's matrices describe
    support: tuple[Support, ...] = Field((), max_length=100, description="[[rotor.support]] tables")

    def supports_off_the_shaft(self, span: tuple[float, float]) -> list[InitErrorDetails]:
        """Problems of the supports that are not on a shaft that reaches over `span` [m]."""
        required = "expected the support's place on the shaft; add it, in m."
        return [
            problem(text, NOTHING if support.position is None else support.position, "support", k, "position")
            for k, support in enumerate(self.support)
            if (text := required if support.position is None else off_the_shaft(span, support.position))
        ]


class _FlexibleRotor(_AnyRotor):
    """What the rotors that are reduced to modes have in common."""

    flexible_modes: int = Field(0, ge=0, le=100, strict=True, description="a whole number of bending modes, 0 to 100")
    modal_damping: Annotated[float | tuple[float, ...], per_axis(DAMPING)] = 0.0
    bending_frequencies_hz: tuple[Annotated[float, Range(0.1, 1e5, "Hz")], ...] | None = Field(
        None, description="a list of measured free-free frequencies in Hz, ascending"
    )

    @property
    def bending_modes(self) -> int:
        """Bending modes that the model keeps in each plane."""
        return self.flexible_modes

    @model_validator(mode="after")
    def _enough_values(self) -> "_FlexibleRotor":
        modes = self.flexible_modes
        problems = [
            problem(
                f"expected at least {modes} values, one for each of the flexible_modes = {modes} "
                f"bending modes; found {len(value)}. Add the others, or {instead}.",
                value,
                key,
            )
            for key, value, instead in (
                ("modal_damping", self.modal_damping, "write a single number for all"),
                ("bending_frequencies_hz", self.bending_frequencies_hz, "leave the key out"),
            )
            if isinstance(value, tuple) and len(value) < modes
        ]
        frequencies = self.bending_frequencies_hz or ()
        if list(frequencies) != sorted(set(frequencies)):
            problems.append(
                problem("expected ascending frequencies; sort them.", frequencies, "bending_frequencies_hz")
            )
        refuse(*problems)
        return self


class FiniteElementRotor(_FlexibleRotor):
    """Shaft of cylindrical sections with rigid disks, to be modelled by Timoshenko beam elements.

    Parameters
    ----------
    flexible_modes : int
        Bending modes kept per plane; 0 is the rigid rotor.
    modal_damping : float or sequence of float
        Damping ratio of all, or of each, bending mode.
    bending_frequencies_hz : sequence of float, optional
        Measured free-free at rest; the modes are scaled to them. At least `flexible_modes` values.
    material : Material, optional
        Of every section that does not name its own.
    section : sequence of Section
        The shaft, end to end from z = 0 on.
    disk : sequence of Disk
        What sits on the shaft.
    mass_damping : float
        Viscous damping to ground of the whole rotor over its mass [1/s], such as that of air: C = mass_damping M.
    support : sequence of Support
        Known springs and dampers to ground, beside the magnets.
    """

    kind: Literal["finite_elements"] = "finite_elements"
    material: Material | None = Field(None, description="a table [rotor.material] for all sections")
    section: tuple[Section, ...] = Field(
        min_length=1, max_length=MOST_SECTIONS, description=f"1 to {MOST_SECTIONS} [[rotor.section]] tables"
    )
    disk: tuple[Disk, ...] = Field((), max_length=MOST_SECTIONS, description="[[rotor.disk]] tables")

    @property
    def span(self) -> tuple[float, float]:
        """First and last z of the shaft [m]."""
        return 0.0, round(math.fsum(s.length for s in self.section), 9)

    @model_validator(mode="after")
    def _on_the_shaft(self) -> "FiniteElementRotor":
        problems = [
            problem(text, disk.position, "disk", k, "position")
            for k, disk in enumerate(self.disk)
            if (text := off_the_shaft(self.span, disk.position))
        ]
        problems += self.supports_off_the_shaft(self.span)
        bare = [k for k, section in enumerate(self.section) if section.material is None]
        if bare and self.material is None:
            text = f"section[{bare[0]}] names no material of its own; add a table [rotor.material]."
            problems.append(problem(text, NOTHING, "material"))
        refuse(*problems)
        return self


class MatrixRotor(_FlexibleRotor):
    """Free rotor by its matrices, M q'' + (C + speed G) q' + K q = f, freedoms [u_x, u_y, theta_x, theta_y] per node.

    Parameters
    ----------
    node_positions : sequence of float
        z of the N nodes [m], ascending.
    M : (4 N, 4 N) array_like
        Mass matrix, SI units; symmetric, positive definite.
    K : (4 N, 4 N) array_like
        Stiffness matrix, SI units; symmetric.
    G : (4 N, 4 N) array_like, optional
        Gyroscopic matrix, SI units; it is multiplied by the speed in rad/s.
    C : (4 N, 4 N) array_like, optional
        Damping matrix, SI units; symmetric. It damps beside `modal_damping` and `mass_damping`.
    file : path, optional
        `.npz` or `.mat` with these five instead, relative to the rig file. It is read at once: the rotor
        keeps the matrices, not the path.
    flexible_modes, modal_damping, bending_frequencies_hz, mass_damping, support
        As for `FiniteElementRotor`.
    """

    kind: Literal["matrices"] = "matrices"
    node_positions: tuple[Position, ...] = Field(
        min_length=2, max_length=MOST_NODES, description=f"a list of 2 to {MOST_NODES} positions in m"
    )
    M: Matrix = Field(description="a square matrix, 4 rows per node")
    K: Matrix = Field(description="a square matrix, 4 rows per node")
    G: Matrix | None = Field(None, description="a square matrix, 4 rows per node")
    C: Matrix | None = Field(None, description="a square matrix, 4 rows per node")

    _findings: tuple[Finding, ...] = PrivateAttr(())

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was left out where it was taken over from another program; no part of its equality."""
        return self._findings

    def with_findings(self, findings: Sequence[Finding]) -> "MatrixRotor":
        """The same rotor with what is to be known of where it is from."""
        noted = self.model_copy()
        noted._findings = tuple(findings)
        return noted

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MatrixRotor) and vars(self) == vars(other)

    def __hash__(self) -> int:
        """Of all but the matrices, which are large; equality compares them too."""
        own = (self.node_positions, self.flexible_modes, self.modal_damping, self.bending_frequencies_hz)
        return hash((*own, self.mass_damping, self.support))

    @property
    def span(self) -> tuple[float, float]:
        """First and last z of the shaft [m]."""
        return self.node_positions[0], self.node_positions[-1]

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or "file" not in data:
            return data
        name = data["file"]
        given = {key: data[key] for key in data if key != "file"}
        twice = [key for key in MATRIX_KEYS if key in given]
        if twice:
            refuse(problem(f"expected either file or {', '.join(twice)}; remove one of them.", name, "file"))
        if not isinstance(name, str | Path) or Path(name).suffix not in (".npz", ".mat"):
            refuse(problem("expected the path of an .npz or .mat file.", name, "file"))
        return given | matrices_of_file(Path((info.context or {}).get("directory", "."), name), name)

    @model_validator(mode="after")
    def _consistent(self) -> "MatrixRotor":
        if list(self.node_positions) != sorted(set(self.node_positions)):
            refuse(problem("expected ascending positions; sort the nodes.", self.node_positions, "node_positions"))
        size = 4 * len(self.node_positions)
        shape_problems = _wrong_shapes({"M": self.M, "K": self.K, "G": self.G, "C": self.C}, size)
        refuse(*shape_problems, *self.supports_off_the_shaft(self.span))
        for key, given in (("M", self.M), ("K", self.K), ("C", self.C or ((0.0,),))):
            matrix = np.array(given)
            gap = float(np.abs(matrix - matrix.T).max())
            if gap > 1e-6 * float(np.abs(matrix).max()):
                text = f"expected a symmetric matrix, entries differ by {gap:.3g}; is a row or an entry misplaced?"
                refuse(problem(text, getattr(self, key), key))
        try:
            np.linalg.cholesky(np.array(self.M))
        except np.linalg.LinAlgError:
            text = "expected a positive definite matrix; does a node lack mass or inertia?"
            refuse(problem(text, self.M, "M"))
        if self.G is not None:
            refuse(*too_polar(polar_over_transverse(self.M, self.G, self.node_positions), self.G, "G"))
        return self


class ModalRotor(_AnyRotor):
    """Free rotor by its mass-normalised modes of one plane; the other plane has the same.

    Parameters
    ----------
    frequencies_hz : sequence of float
        n natural frequencies [Hz]; 0 for a rigid mode.
    damping : sequence of float
        n damping ratios.
    positions : sequence of float
        z of the P points where the shapes are given [m], ascending; every magnet and sensor is one of them. Missing
        physics is tried between them too where they lie closer than 0.3 of a half-wave of the highest mode kept.
    shapes : (n, P) array_like
        Mode shapes [1/sqrt(kg)].
    gyroscopic : (n, n) array_like, optional
        Coupling of plane x to plane y, per rad/s of speed.
    flexible_modes : int, optional
        Bending modes kept per plane, lowest first, of those listed; all if left out.
    mass_damping, support
        As for `FiniteElementRotor`; a support lies at one of `positions`, or between them as magnets may.
    """

    kind: Literal["modes"] = "modes"
    frequencies_hz: tuple[Annotated[float, Range(0.0, 1e5, "Hz", (), "0 for a rigid mode")], ...] = Field(
        min_length=1, description="a list of natural frequencies in Hz, 0 for a rigid mode"
    )
    damping: tuple[Annotated[float, DAMPING], ...] = Field(description="a list of damping ratios, one per mode")
    positions: tuple[Position, ...] = Field(min_length=2, description="a list of two or more positions in m")
    shapes: Matrix = Field(description="one list per mode with its values at the positions, in 1/sqrt(kg)")
    gyroscopic: Matrix | None = Field(None, description="a square matrix, one row per mode")
    flexible_modes: int | None = Field(
        None, ge=0, le=100, strict=True, description="a whole number of bending modes, 0 to as many as are listed"
    )

    @property
    def bending_modes(self) -> int:
        """Bending modes that the model keeps in each plane."""
        return self.listed_bending_modes if self.flexible_modes is None else self.flexible_modes

    @property
    def listed_bending_modes(self) -> int:
        """Modes with a frequency, whether the model keeps them or not."""
        return sum(frequency > 0.0 for frequency in self.frequencies_hz)

    @property
    def span(self) -> tuple[float, float]:
        """First and last z of the shaft [m]."""
        return self.positions[0], self.positions[-1]

    @model_validator(mode="after")
    def _consistent(self) -> "ModalRotor":
        modes, points = len(self.frequencies_hz), len(self.positions)
        problems = []
        if len(self.damping) != modes:
            text = f"expected {modes} values, one for each of frequencies_hz; found {len(self.damping)}."
            problems.append(problem(text, self.damping, "damping"))
        if list(self.positions) != sorted(set(self.positions)):
            problems.append(problem("expected ascending positions; sort the points.", self.positions, "positions"))
        if len(self.shapes) != modes or any(len(row) != points for row in self.shapes):
            text = f"expected {modes} lists (one per mode) of {points} values (one per position)."
            problems.append(problem(text, self.shapes, "shapes"))
        if self.gyroscopic is not None:
            wrong = _wrong_shapes({"gyroscopic": self.gyroscopic}, modes)
            rigid = [k for k, frequency in enumerate(self.frequencies_hz) if frequency == 0.0]
            if not wrong and rigid:
                own = np.array(self.gyroscopic)[np.ix_(rigid, rigid)]
                wrong = too_polar(float(np.linalg.norm(own, 2)), self.gyroscopic, "gyroscopic")
            problems += wrong
        if self.bending_modes > self.listed_bending_modes:
            text = f"expected at most {self.listed_bending_modes}, the modes of frequencies_hz above 0 Hz."
            problems.append(problem(text, self.flexible_modes, "flexible_modes"))
        problems += self.supports_off_the_shaft(self.span)
        refuse(*problems)
        return self


class PointMassRotor(_AnyRotor):
    """A plain mass on one axis: a single-axis levitator.

    Parameters
    ----------
    mass : float
        That levitates [kg].
    mass_damping, support
        As for `FiniteElementRotor`; supports need no position.
    """

    kind: Literal["mass"] = "mass"
    mass: Annotated[float, MASS]

    @property
    def bending_modes(self) -> int:
        """None: a point mass does not bend."""
        return 0

    @property
    def span(self) -> None:
        """A point mass has no shaft: positions mean nothing."""
        return None


def _kind(value: Any) -> Any:
    return value.get("kind", "finite_elements") if isinstance(value, dict) else getattr(value, "kind", None)


Rotor = Annotated[
    Annotated[FiniteElementRotor, Tag("finite_elements")]
    | Annotated[MatrixRotor, Tag("matrices")]
    | Annotated[ModalRotor, Tag("modes")]
    | Annotated[PointMassRotor, Tag("mass")],
    Discriminator(_kind),
]


def off_the_shaft(span: tuple[float, float], position: float) -> str | None:
    """Say that a position is not on a shaft that reaches over `span` [m], its ends included; None if it is."""
    first, last = span
    if first - SAME_PLACE <= position <= last + SAME_PLACE:
        return None
    slips = (MILLIMETRES,) if abs(position) > 10.0 * (last - first) else ()
    return Range(first, last, "m", slips, "the shaft").complaint(position)


def _wrong_shapes(matrices: dict[str, Any], size: int) -> list[InitErrorDetails]:
    return [
        problem(f"expected {size} rows of {size} numbers; found {len(matrix)} rows.", matrix, key)
        for key, matrix in matrices.items()
        if matrix is not None and (len(matrix) != size or any(len(row) != size for row in matrix))
    ]
