"""After an effect was added: which parameters moved, by how many standard errors, and towards what."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid.identification.covariance import covariance
from ambid.model import Model
from ambid.model.parameter import nominal
from ambid.noise import Comparison

REPORTED = 2.0
"""Standard errors beyond which a change is reported."""


@dataclass(frozen=True)
class Moved:
    """A parameter that adding or removing an effect has moved.

    Attributes
    ----------
    name, unit : str
    before, after : float
    std_error : float
        Of the value after; NaN where that is unknown.
    nominal : float or None
        What the rig file says; None of a parameter of an effect.
    """

    name: str
    unit: str
    before: float
    after: float
    std_error: float
    nominal: float | None

    @property
    def errors(self) -> float:
        """By how many standard errors of the value after."""
        return (self.after - self.before) / self.std_error if self.std_error > 0.0 else np.nan

    @property
    def percent(self) -> float:
        """By how much of the value before."""
        return 100.0 * (self.after - self.before) / abs(self.before) if self.before else np.nan

    @property
    def is_nearer(self) -> bool:
        """Whether it moved towards the rig file's value."""
        return self.nominal is not None and abs(self.after - self.nominal) < abs(self.before - self.nominal)

    def line(self) -> str:
        """Such as ``K_i.A_zeta 231.2 -> 217.2 N/A, -14 standard errors, towards 216 of the rig file``."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        text = f"{self.name} {self.before:.5g} -> {self.after:.5g}{unit}, {self.errors:+.3g} standard errors"
        if self.nominal is None:
            return text
        return f"{text}, {'towards' if self.is_nearer else 'away from'} the rig file's {self.nominal:.5g}"

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "parameter": self.name,
            "unit": self.unit,
            "before": self.before,
            "after": self.after,
            "std_error": self.std_error,
            "standard_errors": self.errors,
            "percent": self.percent,
            "nominal": self.nominal,
        }


def moved(before: Model, after: Model, std_errors: Mapping[str, float]) -> tuple[Moved, ...]:
    """Parameters that two models share, those that moved by most standard errors first.

    Parameters
    ----------
    before, after : Model
    std_errors : mapping of str to float
        Of the parameters after.
    """
    known = {p.name: p.value for p in before.parameters}
    stated = {p.name: p.value for p in nominal(after.rig)}
    found = [
        Moved(p.name, p.unit, known[p.name], p.value, std_errors.get(p.name, np.nan), stated.get(p.name))
        for p in after.parameters
        if p.name in known
    ]
    return tuple(sorted(found, key=lambda own: -np.nan_to_num(abs(own.errors))))


def standard_errors(fit: Comparison) -> dict[str, float]:
    """Of all parameters of a fitted model."""
    names = fit.model.names
    return dict(zip(names, np.sqrt(np.diag(covariance(fit, range(len(names))))).tolist(), strict=True))
