"""Values of the rig file known to a tolerance: what the records make of them, and what they add to intervals."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.findings import Finding, Kind, Where
from ambid.model import Model
from ambid.results import READABLE, readable
from ambid.rig import Rig

Budget = Mapping[str, Mapping[str, float]]
"""Variance of every parameter by what it comes from, in its unit squared."""
NOISE = "noise"
"""What the statistical part of a variance comes from."""
LEAST_SHARE = 0.01
"""Of a variance: what makes less is not printed."""
LEAST_PERCENT = 0.1
"""What is less is printed as less than that."""
MOVED = 1.5
"""Standard deviations of its tolerance beyond which a moved value of the rig file is reported: one in eight is, by
chance."""
TYPICAL = Kind(
    "typical_tolerances",
    "note",
    "[tolerance] of the rig file has no {keys}: typical standard deviations are assumed, {values}",
    "state them in [tolerance], or write exact = true there",
)
VALUE_MOVED = Kind(
    "rig_value_moved",
    "note",
    "the data move {name} by {error:+.3g|{shown}} (standard deviation {posterior_std:.2g|{shown}}; "
    "tolerance {std:.3g|{shown}})",
    "check the value in the rig file; within three tolerances it is an ordinary error of it",
)


@dataclass(frozen=True)
class KnownValue:
    """A value of the rig file that is known to a tolerance, as its error from the rig file.

    Attributes
    ----------
    std : float
        Standard deviation before the records, from the rig file.
    posterior_value, posterior_std : float
        Error from the rig file that the records and the tolerance together give, and its standard deviation.
    unit : str
        ``1`` for a relative error.
    """

    std: float
    posterior_value: float
    posterior_std: float
    unit: str

    def texts(self) -> tuple[str, str, str]:
        """Tolerance, error and its standard deviation, each with its unit, such as ``0.5 mm``."""
        std, error, after = (readable(x, self.unit) for x in (self.std, self.posterior_value, self.posterior_std))
        return std.removeprefix("+"), error, after.removeprefix("+")

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON; `value` is the error before the records."""
        return {
            "value": 0.0,
            "std": self.std,
            "posterior_value": self.posterior_value,
            "posterior_std": self.posterior_std,
            "unit": self.unit,
        }


def known_values(model: Model, covariance: FloatArray, fitted: Iterable[int]) -> dict[str, KnownValue]:
    """The known values of a model that were fitted, by name; the covariance is that of all its parameters."""
    own = set(fitted)
    return {
        p.name: KnownValue(float(p.prior), float(p.value), float(np.sqrt(covariance[i, i])), p.unit)
        for i, p in enumerate(model.parameters)
        if p.prior is not None and i in own
    }


def budget_by_name(names: Sequence[str], known: Collection[str], rows: FloatArray) -> Budget:
    """What `covariance.budget` has, of each parameter that is not known to a tolerance itself."""
    return {
        name: {NOISE: float(row[0])}
        | {other: float(x) for other, x in zip(names, row[1:], strict=True) if other in known}
        for name, row in zip(names, rows, strict=True)
        if name not in known
    }


def shares(variances: Mapping[str, float]) -> list[tuple[str, float]]:
    """Parts of a variance, 0 to 1, largest first."""
    total = sum(variances.values())
    parts = [(name, own / total if total > 0.0 else np.nan) for name, own in variances.items()]
    return sorted(parts, key=lambda part: -part[1])


def lines(known: Mapping[str, KnownValue], budget: Budget) -> Iterator[str]:
    """A table of the known values, and for every parameter what makes the most of its variance."""
    if not known:
        return
    yield f"{'value of the rig file':32s} {'tolerance':>14s} {'error by the data':>18s} {'std deviation':>15s}"
    yield "-" * 82
    for name, own in known.items():
        before, error, after = own.texts()
        yield f"{name:32s} {before:>14s} {error:>18s} {after:>15s}"
    yield ""
    yield "what makes the variance of each parameter:"
    for name, variances in budget.items():
        yield f"  {name:12s} {share_text(variances)}"


def share_text(variances: Mapping[str, float]) -> str:
    """The largest parts of a variance in a line, and that of noise: ``sensor_gain.A_zeta 61 %, noise 2 %``."""
    parts = shares(variances)
    # tolerances that are printed of each parameter, beside noise
    largest = [own for own in parts if own[0] != NOISE and own[1] >= LEAST_SHARE][:3]
    shown = sorted([*largest, *(own for own in parts if own[0] == NOISE)], key=lambda own: -own[1])
    return ", ".join(f"{name} {percent(part)} %" for name, part in shown)


def percent(part: float) -> str:
    """A part from 0 to 1 in percent, with two digits."""
    if np.isnan(part):
        return "-"
    if part < LEAST_PERCENT / 100.0:
        return f"< {LEAST_PERCENT:g}"
    return f"{100.0 * part:.0f}" if part >= 0.0995 else f"{100.0 * part:.2g}"


def findings_of(rig: Rig, known: Mapping[str, KnownValue]) -> Iterator[Finding]:
    """Which tolerances are typical ones, and which values of the rig file the records move."""
    fitted = {name.partition(".")[0] for name in known}
    if keys := [key for key in rig.tolerance.typical_keys if key in fitted]:
        where = Where(file=str(rig.path or ""), key="tolerance")
        yield TYPICAL(where, keys=keys, values=[f"{key} = {rig.known_to(key):g}" for key in keys])
    for name, own in known.items():
        if abs(own.posterior_value) > MOVED * own.std:
            yield VALUE_MOVED(
                Where(file=str(rig.path or ""), key=name),
                name=name,
                error=own.posterior_value,
                unit=own.unit,
                shown=READABLE[own.unit][1],
                posterior_std=own.posterior_std,
                std=own.std,
            )
