"""What an identification found: values, intervals, fit, and how it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ambid.arrays import ByValue, ComplexArray, FloatArray
from ambid.effects.magnet import ForceNonlinearity
from ambid.errors import UnknownParameterError, did_you_mean
from ambid.findings import NOWHERE, Finding, Kind, WithFindings
from ambid.identification.curvature import Curvature, with_curvature
from ambid.identification.tolerances import Budget, KnownValue, lines, percent
from ambid.model import Model, Parameter
from ambid.noise import Adequacy, Comparison
from ambid.noise.compared import averaged_over
from ambid.record import Measurement
from ambid.results import Named, OfParameters, Tabular, of_unit, plain

NORMAL_95 = 1.959964
"""Half width of a 95 % interval of the normal distribution, in standard errors."""
STATUS = {
    "converged": "the optimum was found: steps and gradient are below their tolerances",
    "at_bound": "the optimum lies on a bound of the parameters that a finding names; intervals are one-sided there",
    "max_evaluations": "the evaluations ran out before the optimum was found; the values are the best so far",
    "stopped": "stopped by the user; the values are the best so far",
    "not_identifiable": "these records do not determine the parameters that have no value, alone or together; which "
    "changes of them leave no trace is in the JSON as `not_identifiable`",
}
RECORD_PERIODS = Kind(
    "next_record_periods",
    "note",
    "record three periods or more: without the noise it cannot be determined whether the model is right",
)
EXCITE_MORE = Kind(
    "next_excite_more",
    "note",
    "excite every axis, at more frequencies, with more amplitude or over more periods: not all parameters are "
    "determined",
)
EXCITE_AND_DIAGNOSE = Kind(
    "next_excite_and_diagnose",
    "note",
    f"{EXCITE_MORE.message}; physics is missing too: diagnose the records",
)
FIT_FORCE_LAW = Kind(
    "next_fit_force_law",
    "note",
    "fit the force law in place of its slopes: diagnose the records with the effect {effect}; or record a smaller "
    "motion",
)
VALIDATE = Kind("next_validate", "note", "validate the model on a record at another amplitude")
DIAGNOSE = Kind("next_diagnose", "note", "diagnose the records, to name what is missing")


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
        95 % confidence interval; it ends at 0 where physics allows one sign alone, as of a lag.
    unit : str
    std_error_statistical : float or None
        Part of the standard error by noise alone, as if the rig file were exact where it states a tolerance.
    """

    value: float | None
    std_error: float | None
    ci95: tuple[float, float] | None
    unit: str
    std_error_statistical: float | None = None

    @classmethod
    def normal(cls, value: float, std_error: float, unit: str, statistical: float | None = None) -> ParameterEstimate:
        """With the 95 % interval of the normal distribution."""
        ci95 = (value - NORMAL_95 * std_error, value + NORMAL_95 * std_error)
        return cls(value, std_error, ci95, unit, std_error if statistical is None else statistical)

    @classmethod
    def of(cls, parameter: Parameter, std_error: float, statistical: float | None = None) -> ParameterEstimate:
        """Of a parameter of a model, at its value; an interval holds no value of a sign that physics excludes."""
        own = cls.normal(parameter.value, std_error, parameter.unit, statistical)
        low, high = own.ci95 or (np.nan, np.nan)
        if parameter.lower >= 0.0 and low < 0.0:
            return replace(own, ci95=(0.0, high))
        if parameter.upper <= 0.0 and high > 0.0:
            return replace(own, ci95=(low, 0.0))
        return own

    def line(self) -> str:
        """Value, 95 % interval and unit, as far as they are known."""
        if self.value is None:
            return "not identifiable from these records"
        low, high = self.ci95 or (np.nan, np.nan)
        interval = f"   {low:.6g} .. {high:.6g}" if np.isfinite(high - low) else ""
        return f"{self.value:13.6g}{interval}{of_unit(self.unit)}"

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "value": self.value,
            "std_error": self.std_error,
            "ci95": None if self.ci95 is None else list(self.ci95),
            "std_error_statistical": self.std_error_statistical,
            "unit": self.unit,
        }


def columns_of(parameters: Mapping[str, ParameterEstimate]) -> dict[str, list[Any]]:
    """Table of parameters, a row each."""
    found = parameters.values()
    return {
        "parameter": list(parameters),
        "value": [p.value for p in found],
        "std_error": [p.std_error for p in found],
        "std_error_statistical": [p.std_error_statistical for p in found],
        "ci95_low": [None if p.ci95 is None else p.ci95[0] for p in found],
        "ci95_high": [None if p.ci95 is None else p.ci95[1] for p in found],
        "unit": [p.unit for p in found],
    }


@dataclass(frozen=True, repr=False, eq=False)
class Estimate(ByValue, OfParameters[ParameterEstimate], WithFindings, Tabular):
    """Result of `identify`.

    Attributes
    ----------
    model : Model
        The model at the estimated values, with their covariance, ready to simulate.
    parameters : dict of str to ParameterEstimate
        Every free parameter.
    covariance : ndarray, shape (free, free)
        Of the free parameters, in the order of `parameters`; NaN where not identifiable.
    status : str
        One of `STATUS`, which says what it means.
    directions : list of dict
        Parameter combinations that the records do not determine: relative change by parameter.
    evaluations : int
        Of residual and Jacobian.
    seconds : float
        Wall time.
    comparison : Comparison
        The model against its records, in the noise that it was fitted in.
    curvature : Curvature or None
        What the law of a single magnet would move, where it counts beside the noise.
    tolerances : dict of str to KnownValue
        Values of the rig file that are known to a tolerance, and what the records make of them.
    variances : dict of str to dict of str to float
        See `budget`.
    findings : tuple of Finding
        Of the records, and of the fit.
    """

    model: Model
    parameters: dict[str, ParameterEstimate]
    covariance: FloatArray
    status: str
    evaluations: int
    seconds: float
    comparison: Comparison
    directions: list[dict[str, float]] = field(default_factory=list)
    curvature: Curvature | None = None
    tolerances: dict[str, KnownValue] = field(default_factory=dict)
    variances: Budget = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    incidental: ClassVar[tuple[str, ...]] = ("seconds",)

    def __getitem__(self, name: str) -> ParameterEstimate:
        """What was found of a parameter, such as ``estimate["K_i.A_zeta"]``.

        Raises
        ------
        UnknownParameterError
            If it was not free, or there is none of this name.
        """
        if name not in self:
            held = f"{name} was not free" if name in self.model.names else f"{name}: no such parameter"
            hint = did_you_mean(name, self.parameters)
            raise UnknownParameterError(f"{held}; {hint}fitted were {', '.join(self.parameters)}")
        return self.parameters[name]

    def budget(self) -> Budget:
        """Variance of every parameter by what it comes from, in its unit squared (GUM, JCGM 100:2008, 5.1).

        Returns
        -------
        dict of str to dict of str to float
            Of each parameter that of ``noise``, which is its statistical part, and of each tolerance by name.
        """
        return self.variances

    @property
    def settings(self) -> dict[str, tuple[float, str]]:
        """Places and frequencies of effects in the model, such as ``seal_forces.z``, with their units; not fitted."""
        return Named({name: own for effect in self.model.effects for name, own in effect.fine_settings().items()})

    @property
    def records(self) -> tuple[Measurement, ...]:
        """That were fitted."""
        return tuple(own.record for own in self.comparison.records)

    @property
    def simulated(self) -> tuple[FloatArray | ComplexArray, ...]:
        """Response of `model` in each record's experiment, see `RecordComparison.simulated`."""
        return tuple(own.simulated for own in self.comparison.records)

    @property
    def fit_percent(self) -> dict[str, float]:
        """Per channel such as ``y.A_zeta``, and ``average`` over y."""
        return self.comparison.fit_percent

    @property
    def noise_ceiling_percent(self) -> dict[str, float]:
        """Fit that the exact model would reach, likewise; NaN where the noise is not known."""
        return self.comparison.noise_ceiling_percent

    @property
    def misfit(self) -> float:
        """J/dof: 1 when the model is right; NaN where the noise is not known."""
        return self.comparison.misfit

    @property
    def misfit_bound(self) -> float:
        """Misfit up to which a model may be right, see `Comparison.bound`."""
        return self.comparison.bound

    @property
    def adequacy(self) -> Adequacy:
        """Of the comparison, and whether the force has a curvature that its slopes cannot have."""
        return with_curvature(self.comparison.adequacy, self.curvature)

    @property
    def is_adequate(self) -> bool:
        """Whether nothing is left but noise, see `adequacy`."""
        return self.adequacy.is_adequate

    @property
    def inconsistency(self) -> Finding | None:
        """What keeps the model from being adequate, with value and limit; None where nothing does."""
        return self.adequacy.finding

    @property
    def next_step(self) -> Finding:
        """What to do now, by its code."""
        if not self.comparison.is_judged:
            return RECORD_PERIODS(NOWHERE)
        if self.status == "not_identifiable":
            return (EXCITE_MORE if self.comparison.is_adequate else EXCITE_AND_DIAGNOSE)(NOWHERE)
        if self.curvature is not None:
            return FIT_FORCE_LAW(NOWHERE, effect=ForceNonlinearity.name)
        return VALIDATE(NOWHERE) if self.is_adequate else DIAGNOSE(NOWHERE)

    @property
    def next(self) -> str:
        """What to do now, in words."""
        return self.next_step.message

    @property
    def verdict(self) -> str:
        """In a sentence, whether the model explains the records."""
        if not self.comparison.is_judged:
            return "misfit unknown: the noise of these records is not known"
        if self.inconsistency is not None:
            text = self.inconsistency.message
            return text[:1].upper() + text[1:]
        what = f"misfit {self.misfit:.2f}, limit {self.misfit_bound:.2f} (J/dof, 1 when the model is right)"
        if self.misfit > self.comparison.by_chance:
            return f"{what}: good enough, though chance alone brings {self.comparison.by_chance:.2f}: little is missing"
        return f"{what}: nothing is missing that these records can show"

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
            "settings": {name: {"value": value, "unit": unit} for name, (value, unit) in self.settings.items()},
            "fit_percent": plain(self.fit_percent),
            "noise_ceiling_percent": plain(self.noise_ceiling_percent),
            "misfit": plain(self.misfit),
            "misfit_bound": plain(self.misfit_bound),
            "adequate": self.is_adequate,
            "adequacy": plain(self.adequacy.as_dict()),
            "next": self.next,
            "next_step": self.next_step.as_dict(),
            "tolerances": {name: known.as_dict() for name, known in self.tolerances.items()},
            "budget": plain(self.variances) if self.tolerances else {},
            "correlation": {a: {b: plain(correlation[i, j]) for j, b in enumerate(names)} for i, a in enumerate(names)},
            "status": self.status,
            "status_meaning": STATUS[self.status],
            "not_identifiable": self.directions,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "records": [record.name for record in self.records],
            **self.findings_as_dict(),
        }

    def save(self, path: str | Path) -> None:
        """Write the identified model, with its covariance, for ``--model`` and `Model.load`."""
        self.model.save(path)

    def table(self) -> dict[str, list[Any]]:
        """Parameters, a row each."""
        return columns_of(self.parameters)

    def summary(self) -> list[str]:
        """Fit, how it ended, and the findings."""
        fit, ceiling = (values.get("average", np.nan) for values in (self.fit_percent, self.noise_ceiling_percent))
        return [
            self.verdict,
            f"fit {fit:.2f} %, noise ceiling {ceiling:.2f} %",
            f"{self.status}: {STATUS[self.status]}",
            *self.notes,
        ]

    def __str__(self) -> str:
        rows = [] if self.is_adequate or not self.comparison.is_judged else [self.verdict, ""]
        by_noise = f" {'by noise':>11s}" if self.tolerances else ""
        rows += [f"{'parameter':14s} {'value':>13s} {'std error':>11s}{by_noise}   95 % interval"]
        rows += ["-" * (70 + len(by_noise))]
        for name, p in self.parameters.items():
            if p.value is None or p.ci95 is None:
                rows.append(f"{name:14s} {'not identifiable from these records':>40s}")
                continue
            part = f" {p.std_error_statistical:11.3g}" if by_noise else ""
            interval = f"{p.ci95[0]:.6g} .. {p.ci95[1]:.6g}{of_unit(p.unit)}"
            rows.append(f"{name:14s} {p.value:13.6g} {p.std_error:11.3g}{part}   {interval}")
        rows += [f"{name:14s} {own:13.6g}{of_unit(unit)}, as it was set" for name, (own, unit) in self.settings.items()]
        rows += ["forces: f = K_i i + K_s s, K_s > 0 destabilises"]
        if self.tolerances:
            pairs = [(p.std_error_statistical, p.std_error) for p in self.parameters.values()]
            shares = [by_noise / total for by_noise, total in pairs if by_noise is not None and total]
            share = float(np.median(shares)) if shares else np.nan
            rows += [
                f"intervals include {len(self.tolerances)} tolerances of the rig file; noise alone makes "
                f"{percent(share)} % of the median standard error"
            ]
        rows += ["", f"{'channel':14s} {'fit %':>8s} {'noise ceiling %':>16s}", "-" * 40]
        for channel, fit in self.fit_percent.items():
            name = f"average of {averaged_over(self.fit_percent)}" if channel == "average" else channel
            rows.append(f"{name:14s} {fit:8.2f} {self.noise_ceiling_percent.get(channel, np.nan):16.2f}")
        if self.tolerances:
            rows += ["", *lines(self.tolerances, self.variances)]
        rows += ["", self.verdict]
        rows += [f"{self.status}: {STATUS[self.status]} ({self.evaluations} evaluations, {self.seconds:.2f} s)"]
        return "\n".join([*rows, *self.finding_lines(), f"next: {self.next}"])
