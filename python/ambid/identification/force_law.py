"""One force law over the operating points: its slopes are the K_i and K_s of each, its value what static loads say.

K_i and K_s were identified at every point by themselves. A law F(i, g) of current and gap gives all of them at once,
K_i = dF/di and K_s = -dF/dg, from a few numbers. They are fitted by generalised least squares to the identified values
in their covariance, which is as good as a fit to the records themselves where these determine the slopes well (minimum
distance, Malinvaud 1970); what is correlated with them moves with them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from ambid.arrays import ByValue, FloatArray
from ambid.errors import ModelError
from ambid.identification.estimate import ParameterEstimate
from ambid.model import Model
from ambid.model.operating_point import suffix
from ambid.results import Tabular
from ambid.rig import Rig

STEP = 1e-30
"""Of the complex derivative, which has no rounding."""


@dataclass(frozen=True)
class ForceLaw:
    """The force of a magnet as a function of its current and gap, with unknown numbers.

    Attributes
    ----------
    name, equation : str
    start : mapping of str to float
        Its numbers, with values of their own size to start from.
    force : callable
        ``force(i, g, **numbers)`` [N] of current [A] and gap [m]; made of NumPy's analytic functions, since it is
        called with complex values to take its derivatives.
    """

    name: str
    equation: str
    start: Mapping[str, float]
    force: Callable[..., Any]

    def slopes(self, current: FloatArray, gap: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """K_i and K_s, shape (points, 2)."""
        k_i = np.imag(self.force(current + 1j * STEP, gap, **values)) / STEP
        k_s = -np.imag(self.force(current, gap + 1j * STEP, **values)) / STEP
        return np.column_stack([k_i, k_s])


SQUARE = ForceLaw(
    "square",
    "F = k (i + m)^2/(g + a)^2",
    {"k": 1e-5, "m": 1e-3, "a": 1e-4},
    lambda i, g, k, m, a: k * (i + m) ** 2 / (g + a) ** 2,
)
"""A coil on iron without saturation: the air gap is longer by a of iron, and the current by m of a permanent magnet."""
DIPOLES = ForceLaw(
    "dipoles",
    "F = c i (0.01/(g + a))^4 + b (0.01/g)^r",
    {"c": 1.0, "a": 5e-3, "b": 1e-2, "r": 4.0},
    lambda i, g, c, a, b, r: c * i * (0.01 / (g + a)) ** 4 + b * (0.01 / g) ** r,
)
"""A coil on a permanent magnet, as between dipoles, beside what draws the magnet without current."""


class StaticForce(NamedTuple):
    """The force at rest that was measured at a current and a gap, such as the weight that a current holds."""

    current: float
    gap: float
    force: float
    std: float


class _Identified(Protocol):
    """What `identify` and `diagnose` return."""

    model: Model
    parameters: dict[str, ParameterEstimate]
    covariance: FloatArray


@dataclass(frozen=True, repr=False, eq=False)
class LawFit(ByValue, Tabular):
    """Result of `fit_force_law`.

    Attributes
    ----------
    law : ForceLaw
    parameters : dict of str to ParameterEstimate
        The numbers of the law.
    points : ndarray, shape (points, 2)
        Bias current [A] and gap [m] of each operating point.
    identified, std_error, by_law : ndarray, shape (points, 2)
        K_i and K_s as identified, their standard errors, and as the law has them.
    static : tuple of StaticForce
        That were fitted with them.
    misfit : float
        Chi-squared over its degrees of freedom: 1 where the law is right.
    p_value : float
        Chance of such a misfit if the law is right.
    model : Model
        With the K_i and K_s of the law at every point; what is correlated with them has moved with them.
    """

    law: ForceLaw
    parameters: dict[str, ParameterEstimate]
    points: FloatArray
    identified: FloatArray
    std_error: FloatArray
    by_law: FloatArray
    static: tuple[StaticForce, ...]
    misfit: float
    p_value: float
    model: Model

    def force(self, current: float, gap: float) -> float:
        """Force by the law [N] at a current [A] and a gap [m]."""
        return float(self.law.force(current, gap, **self._values()))

    def slopes(self, current: float, gap: float) -> tuple[float, float]:
        """K_i [N/A] and K_s [N/m] by the law, also where no record was taken."""
        k_i, k_s = self.law.slopes(np.array([current]), np.array([gap]), self._values())[0]
        return float(k_i), float(k_s)

    def _values(self) -> dict[str, float]:
        return {name: float(p.value) for name, p in self.parameters.items() if p.value is not None}

    def table(self) -> dict[str, list[Any]]:
        """Operating points, a row each, SI units."""
        columns = {"bias_current": self.points[:, 0], "air_gap": self.points[:, 1]}
        for k, name in enumerate(("K_i", "K_s")):
            columns |= {name: self.identified[:, k], f"{name}_std_error": self.std_error[:, k]}
            columns[f"{name}_by_law"] = self.by_law[:, k]
        return {name: values.tolist() for name, values in columns.items()}

    def summary(self) -> list[str]:
        """The law with its numbers, how well it holds, and what static forces say."""
        numbers = ", ".join(f"{name} = {p.value:.4g} +- {p.std_error:.2g}" for name, p in self.parameters.items())
        held = f"misfit {self.misfit:.2f} (chi-squared/dof, 1 when the law is right), p value {self.p_value:.2g}"
        rows = [
            f"at {s.current:.4g} A, {1e3 * s.gap:.4g} mm: {self.force(s.current, s.gap):.4g} N by the law, "
            f"measured {s.force:.4g} +- {s.std:.2g} N"
            for s in self.static
        ]
        return [f"{self.law.name}: {self.law.equation}; {numbers} (SI)", held, *rows]

    def __str__(self) -> str:
        columns = self.table()
        lines = [" ".join(f"{name:>13s}" for name in columns)]
        lines += [" ".join(f"{value:13.5g}" for value in row) for row in zip(*columns.values(), strict=True)]
        return "\n".join([*lines, "", *self.summary()])


def fit_force_law(
    result: _Identified, law: ForceLaw = SQUARE, static: Sequence[StaticForce] = (), *, axis: str | None = None
) -> LawFit:
    """One force law through the K_i and K_s of all operating points of an axis.

    Parameters
    ----------
    result : Estimate or Diagnosis
        Of records at several bias currents or gaps (`Record.at`), every K_i and K_s of the axis being free.
    law : ForceLaw
        One of this module, or your own.
    static : sequence of StaticForce
        Measured forces at rest, which the law must hold too.
    axis : str, optional
        Name of the axis; the first by default.

    Returns
    -------
    LawFit

    Raises
    ------
    ModelError
        If the axis is unknown, its K_i and K_s are not all identified, or there are no more of them than numbers.
    """
    model, names = result.model, list(result.parameters)
    axis = model.rig.axes[0] if axis is None else axis
    if axis not in model.rig.axes:
        raise ModelError(f"axis {axis}: no such axis; the rig has {', '.join(model.rig.axes)}")
    rigs = {suffix(rig, model.rig): rig for rig in (*model.points, model.rig)}
    wanted = [f"{kind}.{axis}{end}" for end in rigs for kind in ("K_i", "K_s")]
    unknown = [name for name in wanted if name not in names or result.parameters[name].value is None]
    if unknown:
        raise ModelError(
            f"{', '.join(unknown)}: not identified; the law needs K_i and K_s of every operating point free"
        )
    if len(wanted) + len(static) <= len(law.start):
        raise ModelError(
            f"{law.name}: {len(wanted)} slopes and {len(static)} static forces do not test {len(law.start)} numbers; "
            "record at more bias currents or gaps, or give static forces"
        )
    at = [names.index(name) for name in wanted]
    values = np.array([result.parameters[name].value for name in names], dtype=np.float64)
    own = result.covariance[np.ix_(at, at)]
    where = np.array([_point(rig, axis) for rig in rigs.values()])
    found = _fitted(law, where, values[at], own, static)
    by_law = law.slopes(where[:, 0], where[:, 1], found.values)
    moved = values + result.covariance[:, at] @ np.linalg.solve(own, by_law.ravel() - values[at])
    moved[at] = by_law.ravel()
    degrees = len(wanted) + len(static) - len(law.start)
    return LawFit(
        law=law,
        parameters={
            name: ParameterEstimate.normal(value, error, "SI")
            for (name, value), error in zip(found.values.items(), found.std_error, strict=True)
        },
        points=where,
        identified=values[at].reshape(-1, 2),
        std_error=np.sqrt(np.diag(own)).reshape(-1, 2),
        by_law=by_law,
        static=tuple(static),
        misfit=found.chi_squared / degrees,
        p_value=float(chdtrc(degrees, found.chi_squared)),
        model=model.with_values(dict(zip(names, moved.tolist(), strict=True))),
    )


class _Found(NamedTuple):
    values: dict[str, float]
    std_error: list[float]
    chi_squared: float


def _fitted(
    law: ForceLaw, where: FloatArray, slopes: FloatArray, covariance: FloatArray, static: Sequence[StaticForce]
) -> _Found:
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    held = np.array(static, dtype=np.float64).reshape(-1, 4)
    size = np.array(list(law.start.values()))

    def missed(x: FloatArray) -> FloatArray:
        numbers = dict(zip(law.start, (size * x).tolist(), strict=True))
        of_slopes = whiten @ (law.slopes(where[:, 0], where[:, 1], numbers).ravel() - slopes)
        return np.concatenate([of_slopes, (law.force(held[:, 0], held[:, 1], **numbers) - held[:, 2]) / held[:, 3]])

    with np.errstate(all="ignore"):  # numbers that are tried may leave the law's range
        ends = [least_squares(missed, factor * np.ones(len(size)), x_scale="jac") for factor in (1.0, 0.3, 3.0)]
    best = min(ends, key=lambda end: float(end.cost))
    spread = np.linalg.pinv(best.jac.T @ best.jac)
    return _Found(
        dict(zip(law.start, (size * best.x).tolist(), strict=True)),
        (size * np.sqrt(np.diag(spread))).tolist(),
        2.0 * float(best.cost),
    )


def _point(rig: Rig, axis: str) -> tuple[float, float]:
    bearing = next(b for b in rig.bearings if axis in b.axis_names)
    return bearing.bias_current, bearing.air_gap
