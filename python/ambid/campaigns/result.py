"""Result of a campaign: what was found at each bias current, and its tables."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ambid.campaigns.tables import FIRST, Table, save_tables
from ambid.findings import Finding, Kind, Where, WithFindings
from ambid.identification import Estimate, ParameterEstimate, StaticEstimate
from ambid.record import Measurement
from ambid.results import picture
from ambid.rig import Rig

STATIC = "static"
"""Name of the method that is not a kind of records."""
NOT_CONVERGED = Kind("fit_not_converged", "warning", "the fit ended with the status {status}")
NO_LOADINGS = Kind("no_static_loadings", "note", "no static loadings")
BEGIN_ANEW = Kind("next_begin_anew", "note", "make all fits of {campaign} anew")
VALIDATE_MODELS = Kind(
    "next_validate_models", "note", "validate the models on records at another amplitude, bias current or speed"
)
DIAGNOSE_KIND = Kind(
    "next_diagnose_kind",
    "note",
    "find out what the model lacks in {kind} of {folder}: diagnose {record}[, validated on {validate}]",
)


@dataclass(frozen=True, repr=False)
class Runs(WithFindings):
    """Repeated records of one kind at one bias current, such as ``prbs_small_1`` to ``prbs_small_5``.

    Attributes
    ----------
    kind : str
        What their names have in common, such as ``prbs_small``.
    joint : Estimate
        One identification on all runs; gives values and 95 % intervals. What is known to a tolerance of the machine
        is as the joint fits of all bias currents have it.
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
    def findings(self) -> tuple[Finding, ...]:
        """Of the records and the joint fit, and runs that did not converge."""
        runs = [(run.records[0].name, run) for run in self.single] + [(f"all {self.kind}", self.joint)]
        unfinished = [
            NOT_CONVERGED(Where(record=name), status=run.status) for name, run in runs if run.status != "converged"
        ]
        return (*self.joint.findings, *unfinished)

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
class BiasPoint(WithFindings):
    """One bias current of a campaign.

    Attributes
    ----------
    folder : Path
    rig : Rig
    runs : tuple of Runs
        One per kind of record.
    static : StaticEstimate or None
        K_i by static loading; None without loadings.
    begun : tuple of Estimate
        Single runs of the kind in which Ctrl-C came: they have no joint identification.
    """

    folder: Path
    rig: Rig
    runs: tuple[Runs, ...]
    static: StaticEstimate | None
    begun: tuple[Estimate, ...] = ()

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
    def findings(self) -> tuple[Finding, ...]:
        """Of runs and loadings."""
        of_runs = (_placed(finding, runs.kind) for runs in self.runs for finding in runs.findings)
        if self.static is None:
            return (*of_runs, NO_LOADINGS())
        return (*of_runs, *(_placed(finding, STATIC) for finding in self.static.findings))

    def to_json(self) -> dict[str, Any]:
        """Plain data of this bias current."""
        return {
            "folder": self.folder.name,
            "bias_current": {bearing.name: bearing.bias_current for bearing in self.rig.bearings},
            "closed_loop": {runs.kind: runs.to_json() for runs in self.runs},
            "static_load": None if self.static is None else self.static.to_json(),
            "begun": [run.to_json() for run in self.begun],
            **self.findings_as_dict(),
        }


@dataclass(frozen=True, repr=False)
class Campaign(WithFindings):
    """Result of `campaign`.

    Attributes
    ----------
    folder : Path
    points : tuple of BiasPoint
        By rising bias current.
    findings : tuple of Finding
        What was not used.
    is_stopped : bool
        Whether Ctrl-C came before the last fit: then the last point may lack kinds, and the last finding says so.
    """

    folder: Path
    points: tuple[BiasPoint, ...]
    findings: tuple[Finding, ...] = ()
    is_stopped: bool = False

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
            **self.findings_as_dict(),
            "next": self.next,
            "next_step": self.next_step.as_dict(),
            "stopped": self.is_stopped,
        }

    @property
    def tables(self) -> tuple[Table, ...]:
        """K_i by every method, K_s with its scatter, tau_e with its scatter and the fit (Tables 2 and 3)."""
        return _force_current(self), _force_displacement(self), _lag(self)

    def save_tables(self, path: str | Path) -> list[Path]:
        """Write the tables, a file each, such as ``bench_K_s.csv`` for ``bench.csv``; or .tex.

        Raises
        ------
        InputError
            If the suffix is neither .csv nor .tex.
        """
        return save_tables(self.tables, path)

    @property
    def missed(self) -> tuple[BiasPoint, Runs] | None:
        """The bias current and kind of records with the largest misfit over its limit; None where none exceeds it."""
        beyond = [(point, runs) for point in self.points for runs in point.runs if runs.joint.inconsistency is not None]
        return max(beyond, key=lambda each: each[1].joint.misfit / each[1].joint.misfit_bound, default=None)

    @property
    def next_step(self) -> Finding:
        """What to do now, by its code: where a model lacks something, what to diagnose."""
        if self.is_stopped:
            return BEGIN_ANEW(campaign=str(self.folder))
        if self.missed is None:
            return VALIDATE_MODELS()
        point, runs = self.missed
        others = [other.joint.records[0] for other in point.runs if other is not runs]
        return DIAGNOSE_KIND(
            rig=str(point.rig.path),
            kind=runs.kind,
            folder=point.folder.name,
            record=_file(runs.joint.records[0]),
            validate=_file(others[0]) if others else None,
        )

    @property
    def next(self) -> str:
        """What to do now, in words."""
        return self.next_step.message

    plot = picture("plot_campaign")

    def __repr__(self) -> str:
        return f"Campaign({str(self.folder)!r}: {len(self.points)} bias currents; {', '.join(self.methods)})"

    def __str__(self) -> str:
        tables = [*self.tables, _begun(self)]
        lines = [
            line
            for table in tables
            if len(table.heading) > 3 and table.rows  # beyond the columns that say where its numbers are from
            for line in (*table.lines(), "")
        ]
        lines += ["forces: f = K_i i + K_s s, K_s > 0 destabilises"]
        folders: dict[Finding, list[str]] = {}
        for point in self.points:
            for finding in point.findings:
                folders.setdefault(finding, []).append(point.folder.name)
        lines += [f"{own.severity}: {', '.join(where)}: {own.line()}" for own, where in folders.items()]
        return "\n".join([*lines, *self.finding_lines(), f"next: {self.next}"])


def _placed(finding: Finding, kind: str) -> Finding:
    """A finding with the kind of records that it is of, where it has no record."""
    return finding if finding.where.record else finding.at(record=kind)


def _file(record: Measurement) -> str:
    return str(record.path or record.name)


def _force_current(campaign: Campaign) -> Table:
    rows = tuple(
        (
            point.folder.name,
            axis,
            f"{point.bias_current(axis):g}",
            *(interval_text(point.force_current(method, axis)) for method in campaign.methods),
        )
        for point in campaign.points
        for axis in campaign.axes
    )
    title = "K_i [N/A] with 95 % interval, by closed-loop identification and by static loading"
    return Table("K_i", title, (FIRST, "axis", "i0 [A]", *campaign.methods), rows)


def _force_displacement(campaign: Campaign) -> Table:
    rows = []
    for point in campaign.points:
        for runs in point.runs:
            cells = [cell for axis in campaign.axes for cell in _over_runs(runs, f"K_s.{axis}")]
            rows.append((point.folder.name, runs.kind, _bias(point, campaign), *cells))
    heading = [name for axis in campaign.axes for name in (axis, "RSD %")]
    title = "K_s [N/m] and its relative standard deviation over the runs, by axis"
    return Table("K_s", title, (FIRST, "records", "i0 [A]", *heading), tuple(rows))


def _lag(campaign: Campaign) -> Table:
    rows = tuple(
        (
            point.folder.name,
            runs.kind,
            _bias(point, campaign),
            *_over_runs(runs, "tau_e"),
            f"{runs.joint.fit_percent['average']:.2f}",
            f"{runs.joint.noise_ceiling_percent['average']:.2f}",
            f"{runs.joint.misfit:.2f}",
            f"{runs.joint.misfit_bound:.2f}",
        )
        for point in campaign.points
        for runs in point.runs
    )
    title = "tau_e [s] and its relative standard deviation over the runs; average fit of y; misfit J/dof"
    heading = (FIRST, "records", "i0 [A]", "tau_e", "RSD %", "fit %", "noise ceiling %", "misfit", "bound")
    return Table("tau_e", title, heading, rows)


def _begun(campaign: Campaign) -> Table:
    """Every single run that no joint identification followed."""
    names = next((tuple(run.parameters) for point in campaign.points for run in point.begun), ())
    rows = tuple(
        (
            point.folder.name,
            run.records[0].name,
            _bias(point, campaign),
            *("not identifiable" if p.value is None else f"{p.value:.5g}" for p in run.parameters.values()),
            f"{run.fit_percent['average']:.2f}",
            f"{run.misfit:.2f}",
        )
        for point in campaign.points
        for run in point.begun
    )
    heading = (FIRST, "record", "i0 [A]", *names, "fit %", "misfit")
    return Table("begun", "single runs of what is not finished, in SI units", heading, rows)


def _bias(point: BiasPoint, campaign: Campaign) -> str:
    """Bias currents of all bearings, one number where they are the same."""
    return " / ".join(dict.fromkeys(f"{point.bias_current(axis):g}" for axis in campaign.axes))


def _over_runs(runs: Runs, name: str) -> tuple[str, str]:
    value, rsd = runs.joint.parameters[name].value, runs.rsd_percent(name)
    return "not identifiable" if value is None else f"{value:.5g}", "-" if rsd is None else f"{rsd:.2f}"


def interval_text(p: ParameterEstimate | None) -> str:
    """A value and its 95 % interval, short."""
    if p is None:
        return "-"
    if p.value is None or p.ci95 is None:
        return "not identifiable"
    return f"{p.value:.2f} [{p.ci95[0]:.2f}, {p.ci95[1]:.2f}]"
