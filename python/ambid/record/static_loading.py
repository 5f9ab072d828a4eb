"""What was measured under static loads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ByValue
from ambid.errors import RecordError
from ambid.findings import Finding, WithFindings
from ambid.record import checks
from ambid.record.content import COLUMNS_NOT_USED, unused
from ambid.record.raw import numbers
from ambid.record.readers import read_csv_columns
from ambid.rig import Rig


@dataclass(frozen=True, repr=False, eq=False)
class StaticLoading(ByValue, WithFindings):
    """One static loading, M steps: known forces on the levitated rotor and the currents that carry them.

    Attributes
    ----------
    name : str
        What reports call it.
    axes : tuple of str
        Names of the columns of `i_c`.
    z : ndarray, shape (M,)
        Where the force acts [m].
    force : ndarray, shape (M, 2)
        F_x and F_y in global axes [N].
    i_c : ndarray, shape (M, n)
        Mean control currents [A].
    b : ndarray, shape (M, n), or None
        Mean flux densities in the gap [T], of Hall sensors, in the order of `axes`; NaN of an axis that has none.
    findings : tuple of Finding
        Every warning and repair; `notes` are their lines.
    path : Path or None
        File that it came from.
    """

    name: str
    axes: tuple[str, ...]
    z: NDArray[np.float64]
    force: NDArray[np.float64]
    i_c: NDArray[np.float64]
    findings: tuple[Finding, ...] = ()
    path: Path | None = None
    b: NDArray[np.float64] | None = None

    @classmethod
    def load(cls, path: str | Path, rig: Rig | None = None) -> StaticLoading:
        """Read a loading from a .csv file with the columns step, z, F_x, F_y, i_c.<axis>, b.<axis>, and check it.

        Parameters
        ----------
        path : str or Path
            The .csv file.
        rig : Rig, optional
            Its axes are matched by name, and z must lie on its shaft.

        Raises
        ------
        RecordError
            If the file cannot be read, has fewer than 3 steps or no change of load, z is off the shaft, or a flux
            density is of an axis without i_c.
        """
        path = Path(path)
        where = str(path)
        if path.suffix.lower() != ".csv":
            raise RecordError(f"{where}: suffix {path.suffix!r} is not that of a static loading; use .csv")
        read = read_csv_columns(path)
        known = ("step", "z", "F_x", "F_y")
        missing = [name for name in known if name not in read]
        axes = tuple(name.removeprefix("i_c.") for name in read if name.startswith("i_c."))
        if missing or not axes:
            missing += [] if axes else ["i_c.<axis>"]
            raise RecordError(f"{where}: no column {', '.join(missing)}; the columns are {', '.join(read)}")
        hall = [name for name in read if name.startswith("b.")]
        if strange := [name for name in hall if name.removeprefix("b.") not in axes]:
            raise RecordError(
                f"{where}: {', '.join(strange)}: expected b of the axes of i_c, {', '.join(axes)}; rename the column"
            )
        used = (*known, *(f"i_c.{axis}" for axis in axes), *hall)
        columns = {name: numbers(path, name, values) for name, values in read.items() if name in used}
        checks.require_finite(where, columns.items())
        findings = unused(COLUMNS_NOT_USED, (name for name in read if name not in used))
        if rig is not None:
            checks.order_of_axes(where, axes, tuple(rig.axes), "the rig")
            if axes != tuple(rig.axes):
                findings.append(checks.AXES_REORDERED(found=axes, wanted=rig.axes))
                axes = tuple(rig.axes)
        z, force = columns["z"], np.stack([columns["F_x"], columns["F_y"]], axis=1)
        i_c = np.stack([columns[f"i_c.{axis}"] for axis in axes], axis=1)
        if len(z) < 3:
            raise RecordError(f"{where}: {len(z)} load steps; a slope needs at least 3")
        if not np.any(np.ptp(force, axis=0)):
            raise RecordError(f"{where}: the load is {force[0]} N in every step; apply at least two different loads")
        for j, axis in enumerate(axes):
            checks.require_ampere(where, f"i_c.{axis}", i_c[:, j], otherwise="")
            checks.require_alive(where, f"i_c.{axis}", i_c[:, j])
        for name in hall:
            checks.require_size(where, name, columns[name])
            checks.require_alive(where, name, columns[name])
        if rig is not None:
            checks.require_on_shaft(where, z, rig)
        b = np.stack([columns.get(f"b.{axis}", np.full(len(z), np.nan)) for axis in axes], axis=1) if hall else None
        return cls(path.stem, axes, z, force, i_c, tuple(findings), path, b)

    def __repr__(self) -> str:
        largest = np.linalg.norm(self.force, axis=1).max()
        return f"StaticLoading({self.name!r}: {len(self.z)} steps up to {largest:.4g} N; i_c on {', '.join(self.axes)})"
