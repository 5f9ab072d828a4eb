"""Several operating points, each by itself: whether the same effects explain every one, and what they do not share.

A model of several operating points takes all but K_i and K_s as common to them. Where the same effects with values of
their own reach the noise at every point, nothing else is missing there: what the joint model leaves is that a value
changes from point to point, as the resistance of a coil does that warms, or the scale of a sensor that is not linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.candidates import ALPHA
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.covariance import covariance
from ambid.identification.estimate import NORMAL_95
from ambid.identification.minimum import refit
from ambid.noise import Comparison, compare
from ambid.rig import Rig

KNOWN = 0.1
"""Standard error over its value up to which a point determines a parameter."""


@dataclass(frozen=True)
class Changing:
    """A parameter that all operating points share, whose value is another at some of them.

    Attributes
    ----------
    parameter, unit : str
    points : tuple of str
        Where it was determined: the first record of each operating point.
    values, std_errors : tuple of float
    power : float
        Chi-squared of the values about their mean.
    """

    parameter: str
    unit: str
    points: tuple[str, ...]
    values: tuple[float, ...]
    std_errors: tuple[float, ...]
    power: float

    def as_dict(self) -> dict[str, Any]:
        """The smallest and the largest value, with half of their 95 % intervals and points, as values of a finding."""
        found: dict[str, Any] = {"parameter": self.parameter, "unit": None if self.unit == "1" else self.unit}
        for name, k in (("least", int(np.argmin(self.values))), ("most", int(np.argmax(self.values)))):
            half = NORMAL_95 * self.std_errors[k]
            found |= {name: self.values[k], f"{name}_ci95": half, f"{name}_at": self.points[k]}
        return found


def changing(fit: Comparison) -> tuple[Changing, ...]:
    """What changes from point to point, the clearest first, where its effects explain each point by itself.

    Empty where there is one operating point, where one of them is not explained to the noise, and where no value
    differs by more than chance.
    """
    if not fit.model.points:
        return ()
    groups: dict[Rig | None, list[int]] = {}
    for k, record in enumerate(fit.noise.records):
        groups.setdefault(record.point, []).append(k)
    fits = []
    for members in groups.values():
        own = _alone(fit, members)
        if own is None or not own.adequacy.is_within:
            return ()
        fits.append(own)
    names = tuple(own.noise.records[0].name for own in fits)
    found = [_changing(k, names, fits) for k in range(len(fit.model.names))]
    return tuple(sorted((own for own in found if own is not None), key=lambda own: -own.power))


def _alone(joint: Comparison, members: list[int]) -> Comparison | None:
    """The last model, refitted to the records of one point, in their noise; None if it is not stable."""
    try:
        fit = refit(compare(joint.model, [joint.noise.records[k] for k in members]))
        return refit(fit.renewed())
    except (UnstableLoopError, ModelError):
        return None


def _changing(k: int, names: tuple[str, ...], fits: list[Comparison]) -> Changing | None:
    """A parameter at the points that determine it; None where their values agree."""
    parameter = fits[0].model.parameters[k]
    values = np.array([own.model.theta[k] for own in fits])
    errors = np.sqrt([covariance(own, range(len(own.model.names)))[k, k] for own in fits])
    known = np.flatnonzero(errors < KNOWN * np.abs(values))
    if len(known) < 2:
        return None
    weight = errors[known] ** -2.0
    mean = float(weight @ values[known] / weight.sum())
    power = float(weight @ (values[known] - mean) ** 2)
    if power < chdtri(len(known) - 1, ALPHA):
        return None
    found = [tuple(float(own[j]) for j in known) for own in (values, errors)]
    return Changing(parameter.name, parameter.unit, tuple(names[j] for j in known), found[0], found[1], power)
