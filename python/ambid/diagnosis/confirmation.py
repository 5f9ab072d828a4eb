"""Does what is found stand in every part of the records: in both halves, and at each operating point by itself?

What is local in a record, such as a burst, a standstill or a wrong sample, can look like physics: but not on records
to validate on, or, where there are none, on each half of those that it was found on.

A model of several operating points takes all but K_i and K_s as common to them. Where the same effects with values of
their own reach the noise at every point, nothing else is missing there: what the joint model leaves is that a value
changes from point to point, as the resistance of a coil does that warms, or the scale of a sensor that is not linear.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.candidates import ALPHA
from ambid.errors import ModelError, RecordError, UnstableLoopError
from ambid.identification.covariance import covariance
from ambid.identification.estimate import NORMAL_95
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY
from ambid.noise import Comparison, compare
from ambid.noise.angles import undisturbed
from ambid.noise.halves import LEAST_SAMPLES
from ambid.record import Measurement
from ambid.rig import Rig

CHANCE = 0.05
"""Chance of the fall of J that each half must show: what is just sure on a whole record shows half of its score on each
half, and passes 95 % where that score is 15."""
BESIDE = 4
"""Neighbouring frequencies of a response that stay together, since they may have an error in common: bands of a local
estimate."""
LEAST_FREQUENCIES = 16
"""Frequencies of a response whose halves are judged."""
KNOWN = 0.1
"""Standard error over its value up to which a point determines a parameter."""


def is_everywhere(before: Comparison, after: Comparison) -> bool:
    """Whether both halves of the records show what a set of effects brings; where they are too short, it is taken so.

    Parameters
    ----------
    before, after : Comparison
        Of the base model, which is within noise, and of the set.
    """
    records = after.noise.records
    own = after.model.effects[len(before.model.effects) :]
    is_wave = any(effect.quarters(after.model.rig) for effect in own)
    degrees = len(after.model.names) - len(before.model.names)
    split = [halves(record) for record in records]
    for k in (0, 1) if all(split) else ():
        some = [half[k] for half in split]
        if all(record.is_free_response for record in some) and not is_wave:
            continue  # a step moves one half only
        try:
            fall = (_fall_by_wave if is_wave else _fall)(before, after, some)
        except (RecordError, UnstableLoopError):
            continue  # too short to be judged
        if fall < chdtri(degrees, CHANCE):
            return False
    return True


def _fall(before: Comparison, better: Comparison, records: Sequence[Measurement]) -> float:
    """By how much the step lowers J of other records; a wave begins them at another angle, and is left out."""
    base = refit(Comparison(undisturbed(before.model), records), step=ROUGHLY)
    return base.cost - refit(base.of(undisturbed(better.model)), step=ROUGHLY).cost


def _fall_by_wave(before: Comparison, better: Comparison, records: Sequence[Measurement]) -> float:
    """The same where it is itself a wave, which alone has the lines that it is judged on."""
    full = refit(Comparison(better.model, records), step=ROUGHLY)
    return refit(full.of(before.model), step=ROUGHLY).cost - full.cost


def halves(record: Measurement) -> tuple[Measurement, ...]:
    """Both halves of a record, of whole periods, or every other band of a response; nothing if too short."""
    if not record.is_in_time:
        is_first = np.arange(len(record.frequency_hz))[::-1] // BESIDE % 2 == 0
        return (record.some(is_first), record.some(~is_first)) if len(is_first) >= LEAST_FREQUENCIES else ()
    if record.period is None:
        middle = record.samples // 2
        if middle < LEAST_SAMPLES:
            return ()
    else:
        if record.periods < 4:
            return ()
        middle = record.periods // 2 * record.period
    return record.rows(0, middle), record.rows(middle, record.samples)


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
