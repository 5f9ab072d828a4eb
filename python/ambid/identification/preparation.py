"""What every identification begins with: its records held against the model, what is free, and between which bounds."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import ModelError, RecordError
from ambid.identification.problem import Limits
from ambid.identification.starts import spread_starts
from ambid.model import Given, Model, as_model
from ambid.record import Measurement, Record, Source, measured


class Prepared(NamedTuple):
    """An identification before its first descent.

    Attributes
    ----------
    model : Model
        Start values, covering the operating points of all records.
    records : tuple of Measurement
    in_time : tuple of Record
        Those in time.
    free : list of int
        Indices of the free parameters.
    limits : (ndarray, ndarray)
        Bounds of x = theta / scale.
    origins : list of ndarray
        Where descents start.
    known : list of int
        Indices of the errors of the rig file's values that are fitted beside them.
    """

    model: Model
    records: tuple[Measurement, ...]
    in_time: tuple[Record, ...]
    free: list[int]
    limits: Limits
    origins: list[FloatArray]
    known: list[int]


def prepare(
    model: Given,
    records: Source | Sequence[Source],
    free: str | Iterable[str] | None,
    fixed: str | Iterable[str] | Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]] | None,
    starts: int,
    seed: int,
    max_evaluations: int,
) -> Prepared:
    """Take what `identify` was given.

    Raises
    ------
    InputError
        If a name, bound, number or record does not fit the model.
    """
    for name, number, least in (("starts", starts, 1), ("seed", seed, 0), ("max_evaluations", max_evaluations, 1)):
        if number < least:
            raise ModelError(f"{name} = {number}; expected {least} or more")
    model = as_model(model).with_tolerances()
    records = measured(records, model.rig)
    if isinstance(fixed, Mapping):
        model = model.with_values({model.names[i]: v for name, v in fixed.items() for i in model.index([name])})
    _check_records(model, records)
    model = model.covering(records)
    in_time = tuple(record for record in records if record.is_in_time)
    for record in in_time:
        model.excitation(record)  # refuses a record without one
        rate = (record.point or model.rig).sample_rate
        if abs(record.sample_rate / rate - 1.0) > 1e-6:
            where = record.path or record.name
            raise RecordError(f"{where}: {record.sample_rate:g} Hz, the rig samples at {rate:g} Hz")
    held = set(model.index(several(fixed)))
    chosen = set(model.free if free is None else model.index(several(free))) & set(model.free) - held
    if not chosen:
        raise ModelError("no parameter is free; leave some out of `fixed`, or name some in `free`")
    indices = sorted(chosen)
    limits = _limits(model, indices, bounds)
    origins = spread_starts(model.theta, indices, starts, seed)
    known = [i for i, p in enumerate(model.parameters) if p.prior is not None and i not in held]
    return Prepared(model, records, in_time, indices, limits, origins, known)


def beside_known(limits: Limits, model: Model, known: Sequence[int]) -> Limits:
    """Bounds of x with those of the errors of the rig file's values behind them."""
    own = [model.parameters[i] for i in known]
    lower, upper = ([getattr(p, side) / p.scale for p in own] for side in ("lower", "upper"))
    return np.append(limits[0], lower), np.append(limits[1], upper)


def several(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names or patterns, of which one may be given by itself."""
    return (names,) if isinstance(names, str) else tuple(names)


def _check_records(model: Model, records: tuple[Measurement, ...]) -> None:
    if not records:
        raise RecordError("no record was given; give at least one")
    for record in records:
        record.require_rig(model.rig)


def _limits(model: Model, free: list[int], bounds: Mapping[str, tuple[float, float]] | None) -> Limits:
    """Lower and upper bounds of x."""
    lower = np.array([p.lower for p in model.parameters])
    upper = np.array([p.upper for p in model.parameters])
    for name, (low, high) in (bounds or {}).items():
        at = model.index([name])
        if not 0.0 <= low < high:
            raise ModelError(f"bounds of {name}: {low:g} .. {high:g}; expected 0 <= lower < upper, SI units")
        lower[at], upper[at] = low, high
        outside = [model.names[i] for i in at if i in free and not low <= model.theta[i] <= high]
        if outside:
            values = ", ".join(f"{n} = {model.theta[model.names.index(n)]:g}" for n in outside)
            raise ModelError(f"bounds of {name}: the start {values} lies outside {low:g} .. {high:g}; move one of them")
    scale = np.array([model.parameters[i].scale for i in free])
    return lower[free] / scale, upper[free] / scale
