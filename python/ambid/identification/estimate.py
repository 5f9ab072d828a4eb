"""What an identification found: values, intervals, fit, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.model import Model
from ambid.record import Record
from ambid.results import Tabular, plain

STATUS = {
    "converged": "the optimum was found: steps and gradient are below their tolerances",
    "at_bound": "the optimum lies on a bound of the parameters named in the notes; intervals are one-sided there",
    "max_evaluations": "the evaluations ran out before the optimum was found; the values are the best so far",
    "stopped": "stopped by the user; the values are the best so far",
    "not_identifiable": "these records do not determine the parameters named in `directions`; they have no values",
}


@dataclass(frozen=True)
class ParameterEstimate:
    """One estimated number.

    Attributes
    ----------
    value : float or None
        None where the data do not determine it.
    std_error : float or None
        Standard error; None for a parameter that was held fixed.
    ci95 : tuple of float or None
        95 % confidence interval.
    unit : str
    """

    value: float | None
    std_error: float | None
    ci95: tuple[float, float] | None
    unit: str

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "value": self.value,
            "std_error": self.std_error,
            "ci95": None if self.ci95 is None else list(self.ci95),
            "unit": self.unit,
        }


@dataclass(frozen=True, repr=False)
class Estimate(Tabular):
    """Result of `identify`.

    Attributes
    ----------
    model : Model
        The model at the estimated values, ready to simulate.
    parameters : dict of str to ParameterEstimate
        Every free parameter.
    covariance : ndarray, shape (free, free)
        Of the free parameters, in the order of `parameters`; NaN where not identifiable.
    fit_percent, noise_ceiling_percent : dict of str to float
        Per channel such as ``y.A_zeta``, and ``average`` over y; the ceiling is NaN without enough periods.
    status : str
        One of `STATUS`, which says what it means.
    directions : list of dict
        Parameter combinations that the records do not determine: relative change by parameter.
    evaluations : int
        Of residual and Jacobian.
    seconds : float
        Wall time.
    records : tuple of Record
    simulated : tuple of ndarray, shape (N, outputs)
        Response of `model` to each record's excitation; columns as ``model.loop.outputs``.
    notes : tuple of str
    """

    model: Model
    parameters: dict[str, ParameterEstimate]
    covariance: FloatArray
    fit_percent: dict[str, float]
    noise_ceiling_percent: dict[str, float]
    status: str
    evaluations: int
    seconds: float
    records: tuple[Record, ...]
    simulated: tuple[FloatArray, ...]
    directions: list[dict[str, float]] = field(default_factory=list)
    notes: tuple[str, ...] = ()

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the free parameters, in the order of `parameters`."""
        deviation = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(deviation, deviation)

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        names = list(self.parameters)
        correlation = self.correlation
        return {
            "parameters": {name: p.as_dict() for name, p in self.parameters.items()},
            "fit_percent": plain(self.fit_percent),
            "noise_ceiling_percent": plain(self.noise_ceiling_percent),
            "correlation": {a: {b: plain(correlation[i, j]) for j, b in enumerate(names)} for i, a in enumerate(names)},
            "status": self.status,
            "status_meaning": STATUS[self.status],
            "not_identifiable": self.directions,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "records": [record.name for record in self.records],
            "notes": list(self.notes),
        }

    def save(self, path: str | Path) -> None:
        """Write the identified model, with its covariance, for ``--model`` and `Model.load`."""
        names = list(self.parameters)
        at = [self.model.names.index(name) for name in names]
        full = np.full((len(self.model.names),) * 2, np.nan)
        full[np.ix_(at, at)] = self.covariance
        self.model.save(path, full)

    def table(self) -> dict[str, list[Any]]:
        """Parameters, a row each."""
        found = self.parameters.values()
        return {
            "parameter": list(self.parameters),
            "value": [p.value for p in found],
            "std_error": [p.std_error for p in found],
            "ci95_low": [None if p.ci95 is None else p.ci95[0] for p in found],
            "ci95_high": [None if p.ci95 is None else p.ci95[1] for p in found],
            "unit": [p.unit for p in found],
        }

    def summary(self) -> list[str]:
        """Fit, how it ended, and the notes."""
        fit, ceiling = (values.get("average", np.nan) for values in (self.fit_percent, self.noise_ceiling_percent))
        return [
            f"fit {fit:.2f} %, noise ceiling {ceiling:.2f} %",
            f"{self.status}: {STATUS[self.status]}",
            *self.notes,
        ]

    def __repr__(self) -> str:
        lines = [f"{'parameter':14s} {'value':>13s} {'std error':>11s}   95 % interval", "-" * 70]
        for name, p in self.parameters.items():
            if p.value is None or p.ci95 is None:
                lines.append(f"{name:14s} {'not identifiable from these records':>40s}")
                continue
            lines.append(
                f"{name:14s} {p.value:13.6g} {p.std_error:11.3g}   {p.ci95[0]:.6g} .. {p.ci95[1]:.6g} {p.unit}"
            )
        lines += ["forces: f = K_i i + K_s s, K_s > 0 destabilises"]
        lines += ["", f"{'channel':14s} {'fit %':>8s} {'noise ceiling %':>16s}", "-" * 40]
        for channel, fit in self.fit_percent.items():
            lines.append(f"{channel:14s} {fit:8.2f} {self.noise_ceiling_percent.get(channel, np.nan):16.2f}")
        lines += ["", f"{self.status}: {STATUS[self.status]} ({self.evaluations} evaluations, {self.seconds:.2f} s)"]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])
