"""Result of a campaign: what was found at each bias current, and its tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ambid.identification import Estimate, ParameterEstimate, StaticEstimate
from ambid.rig import Rig

__all__ = ["BiasPoint", "Campaign", "Runs"]

STATIC = "static"
"""Name of the method that is not a kind of records."""


@dataclass(frozen=True, repr=False)
class Runs:
    """Repeated records of one kind at one bias current, such as ``prbs_small_1`` to ``prbs_small_5``.

    Attributes
    ----------
    kind : str
        What their names have in common, such as ``prbs_small``.
    joint : Estimate
        One identification on all runs; gives values and 95 % intervals.
    single : tuple of Estimate
        Each run by itself; their scatter is what repeating the experiment changes.
    """

    kind: str
    joint: Estimate
    single: tuple[Estimate, ...]

    def values(self, name: str) -> list[float]:
        """Values of a parameter by the runs that determine it."""
        return [value for run in self.single if (value := run.parameters[name].value) is not None]

    def mean(self, name: str) -> float | None:
        """Mean of a parameter over the runs; None where no run determines it."""
        values = self.values(name)
        return float(np.mean(values)) if values else None

    def rsd_percent(self, name: str) -> float | None:
        """Relative standard deviation of a parameter over the runs [%]; None with fewer than two."""
        values = self.values(name)
        return float(100.0 * np.std(values, ddof=1) / np.mean(values)) if len(values) > 1 else None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the records and the joint fit, and runs that did not converge."""
        runs = [(run.records[0].name, run) for run in self.single] + [(f"all {self.kind}", self.joint)]
        unfinished = [f"{name}: {run.status}" for name, run in runs if run.status != "converged"]
        return (*self.joint.notes, *unfinished)

    def to_json(self) -> dict[str, Any]:
        """Plain data: the joint estimate, mean and RSD over the runs, and every run."""
        return {
            "joint": self.joint.to_json(),
            "over_runs": {
                name: {"mean": self.mean(name), "rsd_percent": self.rsd_percent(name), "unit": p.unit}
                for name, p in self.joint.parameters.items()
            },
            "runs": [run.to_json() for run in self.single],
        }


@dataclass(frozen=True, repr=False)
class BiasPoint:
    """One bias current of a campaign.

    Attributes
    ----------
    folder : Path
    rig : Rig
    runs : tuple of Runs
        One per kind of record.
    static : StaticEstimate or None
        K_i by static loading; None without loadings.
    """

    folder: Path
    rig: Rig
    runs: tuple[Runs, ...]
    static: StaticEstimate | None

    def bias_current(self, axis: str) -> float:
        """Bias current i0 of the bearing that an axis belongs to [A]."""
        return next(bearing.bias_current for bearing in self.rig.bearings if axis in bearing.axis_names)

    def force_current(self, method: str, axis: str) -> ParameterEstimate | None:
        """K_i of an axis by a kind of records or by ``static``; None where that was not measured here."""
        own: dict[str, Estimate | StaticEstimate] = {runs.kind: runs.joint for runs in self.runs}
        if self.static is not None:
            own[STATIC] = self.static
        return own[method].parameters[f"K_i.{axis}"] if method in own else None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of runs and loadings."""
        of_runs = [f"{runs.kind}: {note}" for runs in self.runs for note in runs.notes]
        of_loads = ["no static loadings"] if self.static is None else [f"static: {note}" for note in self.static.notes]
        return (*of_runs, *of_loads)

    def to_json(self) -> dict[str, Any]:
        """Plain data of this bias current."""
        return {
            "folder": self.folder.name,
            "bias_current": {bearing.name: bearing.bias_current for bearing in self.rig.bearings},
            "closed_loop": {runs.kind: runs.to_json() for runs in self.runs},
            "static_load": None if self.static is None else self.static.to_json(),
            "notes": list(self.notes),
        }


@dataclass(frozen=True, repr=False)
class Campaign:
    """Result of `campaign`.

    Attributes
    ----------
    folder : Path
    points : tuple of BiasPoint
        By rising bias current.
    notes : tuple of str
        What was not used.
    """

    folder: Path
    points: tuple[BiasPoint, ...]
    notes: tuple[str, ...] = ()

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return self.points[0].rig.axes

    @property
    def methods(self) -> tuple[str, ...]:
        """Kinds of records at any of the bias currents, then ``static`` if there are loadings."""
        kinds = dict.fromkeys(runs.kind for point in self.points for runs in point.runs)
        return (*kinds, STATIC) if any(point.static for point in self.points) else tuple(kinds)

    def force_current(self) -> Iterator[tuple[BiasPoint, str, str, ParameterEstimate]]:
        """K_i as bias point, axis, method and value: the numbers of the figure."""
        for point in self.points:
            for axis in self.axes:
                for method in self.methods:
                    if (k_i := point.force_current(method, axis)) is not None:
                        yield point, axis, method, k_i

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it; ``K_i`` holds the numbers of the figure as rows."""
        rows = [
            {"folder": point.folder.name, "bias_current": point.bias_current(axis), "axis": axis, "method": method}
            | k_i.as_dict()
            for point, axis, method, k_i in self.force_current()
        ]
        return {
            "campaign": str(self.folder),
            "K_i": rows,
            "points": [point.to_json() for point in self.points],
            "notes": list(self.notes),
        }

    def __repr__(self) -> str:
        lines = ["K_i [N/A] with 95 % interval, by closed-loop identification and by static loading", *self._k_i(), ""]
        lines += ["K_s [N/m] and its relative standard deviation over the runs", *self._k_s(), ""]
        lines += ["tau_e and its relative standard deviation over the runs; average fit of y", *self._tau_e(), ""]
        lines += ["forces: f = K_i i + K_s s, K_s > 0 destabilises"]
        lines += [f"note: {point.folder.name}: {note}" for point in self.points for note in point.notes]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])

    def _k_i(self) -> list[str]:
        rows = [
            [*_place(point, axis), *(_interval(point.force_current(method, axis)) for method in self.methods)]
            for point in self.points
            for axis in self.axes
        ]
        return _table(["folder", "axis", "i0 [A]", *self.methods], rows)

    def _k_s(self) -> list[str]:
        rows = [
            [*_place(point, axis), runs.kind, *_over_runs(runs, f"K_s.{axis}")]
            for point in self.points
            for axis in self.axes
            for runs in point.runs
        ]
        return _table(["folder", "axis", "i0 [A]", "records", "K_s [N/m]", "RSD %"], rows)

    def _tau_e(self) -> list[str]:
        rows = [
            [
                point.folder.name,
                runs.kind,
                *_over_runs(runs, "tau_e"),
                f"{runs.joint.fit_percent['average']:.2f}",
                f"{runs.joint.noise_ceiling_percent['average']:.2f}",
            ]
            for point in self.points
            for runs in point.runs
        ]
        return _table(["folder", "records", "tau_e [s]", "RSD %", "fit %", "noise ceiling %"], rows)


def _place(point: BiasPoint, axis: str) -> list[str]:
    return [point.folder.name, axis, f"{point.bias_current(axis):g}"]


def _over_runs(runs: Runs, name: str) -> list[str]:
    value, rsd = runs.joint.parameters[name].value, runs.rsd_percent(name)
    return ["not identifiable" if value is None else f"{value:.5g}", "-" if rsd is None else f"{rsd:.2f}"]


def _interval(p: ParameterEstimate | None) -> str:
    if p is None:
        return "-"
    if p.value is None or p.ci95 is None:
        return "not identifiable"
    return f"{p.value:.2f} [{p.ci95[0]:.2f}, {p.ci95[1]:.2f}]"


def _table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table; its columns are as wide as they need to be."""
    widths = [max(map(len, column)) for column in zip(heading, *rows, strict=True)]
    lines = [
        "  ".join(f"{cell:>{width}s}" for cell, width in zip(row, widths, strict=True)) for row in (heading, *rows)
    ]
    return [lines[0], "-" * len(lines[0]), *lines[1:]]
