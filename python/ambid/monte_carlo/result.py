"""What many runs show: bias, spread, coverage and correlation of the parameters, and how often what was named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid.arrays import ByValue, FloatArray
from ambid.findings import Finding, Kind, WithFindings
from ambid.identification.estimate import NORMAL_95
from ambid.identification.many import FAILED
from ambid.monte_carlo.plan import Plan
from ambid.monte_carlo.runs import Row
from ambid.results import Tabular, plain

RUNS_FAILED = Kind("runs_failed", "warning", "{failed} of {runs} runs failed: {reason}")
TOO_FEW_RUNS = Kind(
    "too_few_runs", "note", "no bias and no spread: they take two runs that determine a parameter", "make more runs"
)


@dataclass(frozen=True)
class Accuracy:
    """Of one parameter, over the runs that have a value of it.

    Attributes
    ----------
    unit : str
    runs : int
    true : float
        Mean true value.
    bias, bias_std_error : float
        Mean of estimated less true, and its standard error.
    spread : float
        Standard deviation of estimated less true.
    std_error : float
        Root of the mean square of the stated standard errors.
    coverage : float
        Part of the 95 % intervals that hold the truth.
    """

    unit: str
    runs: int
    true: float
    bias: float
    bias_std_error: float
    spread: float
    std_error: float
    coverage: float

    @classmethod
    def of(cls, unit: str, true: FloatArray, errors: FloatArray, stated: FloatArray) -> Accuracy:
        """From runs that all have a value."""
        if (count := len(errors)) < 2:
            return cls(unit, count, *[np.nan] * 6)
        spread = float(errors.std(ddof=1))
        return cls(
            unit=unit,
            runs=count,
            true=float(true.mean()),
            bias=float(errors.mean()),
            bias_std_error=spread / float(np.sqrt(count)),
            spread=spread,
            std_error=float(np.sqrt(np.mean(stated**2))),
            coverage=float(np.mean(np.abs(errors) <= NORMAL_95 * stated)),
        )


@dataclass(frozen=True, repr=False, eq=False)
class MonteCarlo(ByValue, Tabular, WithFindings):
    """Result of `run_monte_carlo`.

    Attributes
    ----------
    plan : Plan
    rows : tuple of dict
        A run each: `run`, `seed`, `status`, `reason`, `misfit`, `misfit_bound`, `adequate`, what was drawn, and of
        every parameter ``NAME.true``, ``NAME.value`` and ``NAME.std_error``; of diagnoses `verdict`, `effects` and
        `ambiguous`.
    parameters : dict of str to Accuracy
    correlation : ndarray, shape (parameters, parameters)
        Of estimated less true; NaN with fewer than three runs.
    """

    plan: Plan
    rows: tuple[Row, ...]
    parameters: dict[str, Accuracy]
    correlation: FloatArray

    @classmethod
    def of(cls, plan: Plan, rows: Sequence[Row]) -> MonteCarlo:
        """From the rows of a plan."""
        names, units = plan.start.names, [p.unit for p in plan.start.parameters]

        def column(what: str) -> FloatArray:
            return np.array([[row[f"{name}.{what}"] for name in names] for row in rows]).reshape(-1, len(names))

        true, stated = column("true"), column("std_error")
        errors = column("value") - true
        known = np.isfinite(errors) & np.isfinite(stated)
        parameters = {
            name: Accuracy.of(unit, *(own[known[:, k], k] for own in (true, errors, stated)))
            for k, (name, unit) in enumerate(zip(names, units, strict=True))
        }
        whole = errors[known.all(axis=1)]
        correlation = np.full((len(names),) * 2, np.nan)
        if len(whole) > 2:
            correlation = np.atleast_2d(np.corrcoef(whole, rowvar=False))
        return cls(plan, tuple(rows), parameters, correlation)

    @property
    def status(self) -> dict[str, int]:
        """Number of runs by how they ended."""
        return dict(Counter(row["status"] for row in self.rows))

    @property
    def reasons(self) -> dict[str, int]:
        """Number of failed runs by their reason, the most frequent first."""
        return dict(Counter(row["reason"] for row in self.rows if row["status"] == FAILED).most_common())

    @property
    def all_failed(self) -> bool:
        """Whether runs were made, and none came to an end."""
        return bool(self.rows) and self.status.get(FAILED, 0) == len(self.rows)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Why runs failed, the most frequent reasons first, which is an error where all did; and too few runs."""
        found = [
            RUNS_FAILED(severity="error" if self.all_failed else None, failed=count, runs=len(self.rows), reason=reason)
            # for which runs failed that are among the findings, the most frequent
            for reason, count in list(self.reasons.items())[:3]
        ]
        if self.rows and not self.all_failed and not self.has_values:
            found.append(TOO_FEW_RUNS())
        return tuple(found)

    @property
    def has_values(self) -> bool:
        """Whether any parameter has a bias and a spread, which two runs with a value give."""
        return any(p.runs > 1 for p in self.parameters.values())

    @property
    def adequate(self) -> float:
        """Part of the runs whose misfit is within its bound."""
        return float(np.mean([row["adequate"] for row in self.rows])) if self.rows else np.nan

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of diagnosed runs by verdict."""
        return dict(Counter(row["verdict"] for row in self._diagnosed))

    @property
    def named(self) -> dict[str, int]:
        """Number of diagnosed runs by effect that was named, alone or in a set."""
        return dict(Counter(name for row in self._diagnosed for name in _names(row)))

    @property
    def truth_named(self) -> float:
        """Part of the diagnosed runs that name all hidden effects; NaN where nothing is hidden, or diagnosed."""
        hidden = {effect.name for effect in self.plan.machine.effects}
        if not (hidden and self._diagnosed):
            return np.nan
        return float(np.mean([hidden <= _names(row) for row in self._diagnosed]))

    @property
    def _diagnosed(self) -> list[Row]:
        return [row for row in self.rows if row["status"] == "diagnosed"]

    def table(self) -> dict[str, list[Any]]:
        """Parameters, a row each."""
        own = self.parameters.values()
        columns = ("true", "bias", "bias_std_error", "spread", "std_error", "coverage", "runs", "unit")
        return {"parameter": list(self.parameters)} | {name: [getattr(p, name) for p in own] for name in columns}

    def summary(self) -> list[str]:
        """How the runs ended, and what was named."""
        counts = ", ".join(f"{count} {word}" for word, count in sorted(self.status.items()))
        lines = [f"{len(self.rows)} runs: {counts or 'none made'}"]
        if self.rows and not self.all_failed:
            lines[0] += f"; misfit within its bound in {100.0 * self.adequate:.1f} %"
        if self.plan.diagnose:
            for what, found in (("verdicts", self.verdicts), ("named", self.named)):
                ranked = sorted(found.items(), key=lambda pair: (-pair[1], pair[0]))
                lines.append(f"{what}: {', '.join(f'{name} {count}' for name, count in ranked) or 'none'}")
            if np.isfinite(self.truth_named):
                lines.append(f"all that is hidden was named in {100.0 * self.truth_named:.1f} %")
        return [*lines, *self.finding_lines()]

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        names = list(self.parameters)
        columns = self.table()
        own = {
            name: {key: values[k] for key, values in columns.items() if key != "parameter"}
            for k, name in enumerate(names)
        }
        correlation = {a: {b: float(self.correlation[i, j]) for j, b in enumerate(names)} for i, a in enumerate(names)}
        found = {
            "runs": len(self.rows),
            "seed": self.plan.seed,
            "parameters": own,
            "correlation": correlation,
            "status": self.status,
            "reasons": self.reasons,
            "adequate": self.adequate,
            "verdicts": self.verdicts,
            "named": self.named,
            "truth_named": self.truth_named,
            **self.findings_as_dict(),
        }
        return plain(found)  # type: ignore[no-any-return]

    def __str__(self) -> str:
        if not self.has_values:
            return "\n".join(self.summary())
        head = f"{'parameter':14s} {'bias %':>9s} {'+-':>8s} {'spread %':>9s} {'stated %':>9s} {'inside 95 %':>12s}"
        lines = [head, "-" * len(head)]
        for name, p in self.parameters.items():
            bias, error, spread, stated = (
                100.0 * value / p.true for value in (p.bias, p.bias_std_error, p.spread, p.std_error)
            )
            lines.append(
                f"{name:14s} {bias:9.3f} {error:8.3f} {spread:9.3f} {stated:9.3f} {100.0 * p.coverage:10.1f} %"
            )
        return "\n".join([*lines, *self.summary()])


def _names(row: Row) -> set[str]:
    return {name for own in (row["effects"], row["ambiguous"].replace(";", ",")) for name in own.split(",") if name}
