"""Closed-loop identification (CLI): the parameters that make the simulated loop follow the measured one (eq. 9)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import ModelError, RecordError, UnstableLoopError
from ambid.identification.covariance import score_covariance
from ambid.identification.estimate import Estimate, ParameterEstimate
from ambid.identification.problem import End, Limits, Problem, noise_levels, padded_outputs
from ambid.model import Model
from ambid.model.parameter import UNITS
from ambid.noise.ceiling import pooled_ceiling
from ambid.noise.colour import loop_noise
from ambid.noise.fit import fit_percent
from ambid.record import Record
from ambid.rig import Rig
from ambid.threads import with_one_blas_thread

__all__ = ["identify"]

NORMAL_95 = 1.959964
"""Half width of a 95 % interval of the normal distribution, in standard errors."""
STABLE_FACTORS = (0.3, 0.45, 0.65, 0.8, 1.0, 1.25, 1.5)
"""Where the start is unstable, these multiples of the start values are tried."""
WHOLLY_UNKNOWN = 1.0
"""A combination of parameters with a relative standard deviation above this is not identifiable."""
UNSEEN_VARIANCE = 1e6
"""Relative variance that stands for infinity, for a combination that moves no output."""


@with_one_blas_thread
def identify(
    model: Model | Rig,
    records: Record | Sequence[Record],
    *,
    free: Iterable[str] | None = None,
    fixed: Iterable[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    weights: Mapping[str, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    max_evaluations: int = 100,
    progress: Callable[[int, float], None] | None = None,
) -> Estimate:
    """Fit the free parameters of a closed-loop model to records by least squares (eq. 9).

    The loop is simulated from rest with each record's excitation; the means of the measured and the simulated signals
    are removed per record and channel, so that gravity and sensor offsets do not matter. Residuals are weighted by the
    noise of their channel: its scatter over the periods, or, without periods, the residual of a first fit.

    Parameters
    ----------
    model : Model or Rig
        Start values; a rig means its nominal values.
    records : Record or sequence of Record
        Of this rig, all with the same axes and sample rate.
    free : iterable of str, optional
        Names or patterns such as ``K_i`` or ``K_s.A_*``; default all.
    fixed : iterable of str
        Names or patterns that keep their start values.
    bounds : mapping of str to (float, float), optional
        By name or pattern, SI units; default positive.
    weights : mapping of str to float, optional
        Further factors for the signals ``y`` and ``i_c``, or single channels such as ``y.A_zeta``; 0 leaves them out.
    starts : int
        Number of starts; those after the first are spread by about 30 % around it, and the best end counts.
    seed : int
        Of the spread.
    max_evaluations : int
        Per start.
    progress : callable, optional
        Called with the number of evaluations and the present cost.

    Returns
    -------
    Estimate

    Raises
    ------
    UnstableLoopError
        If the loop is unstable at every start.
    InputError
        If a name, bound, weight or record does not fit the model.
    """
    begun = time.perf_counter()
    for name, number, least in (("starts", starts, 1), ("seed", seed, 0), ("max_evaluations", max_evaluations, 1)):
        if number < least:
            raise ModelError(f"{name} = {number}; expected {least} or more")
    model = Model(model) if isinstance(model, Rig) else model
    records = (records,) if isinstance(records, Record) else tuple(records)
    _check_records(model, records)
    model = model.covering(records)
    for record in records:
        model.excitation(record)  # refuses a record without one
    chosen = set(range(len(model.names)) if free is None else model.index(free)) - set(model.index(fixed))
    if not chosen:
        raise ModelError("no parameter is free; leave some out of `fixed`, or name some in `free`")
    problem = Problem(model, records, sorted(chosen), noise_levels(records), _factors(model, weights), progress)
    limits = _limits(model, problem.free, bounds)
    best, notes = _best_of(problem, _starts(model.theta, problem.free, limits, starts, seed), limits, max_evaluations)
    if not all(record.periods >= 3 for record in records):
        # without a scatter over periods the first fit's residual is the noise
        problem = problem.with_noise(problem.residual_rms(best.theta))
        again, more = _best_of(problem, [best.theta[problem.free]], limits, max_evaluations)
        best, notes = again, [*notes, *more]
    return _estimate(problem, best, limits, notes, begun)


def _check_records(model: Model, records: tuple[Record, ...]) -> None:
    if not records:
        raise RecordError("no record was given; give at least one")
    for record in records:
        where = record.path or record.name
        if record.axes != model.rig.axes:
            raise RecordError(
                f"{where}: axes {', '.join(record.axes)}, the rig has {', '.join(model.rig.axes)}; "
                "load the record with its rig"
            )
        if abs(record.sample_rate / model.rig.sample_rate - 1.0) > 1e-6:
            raise RecordError(f"{where}: {record.sample_rate:g} Hz, the rig samples at {model.rig.sample_rate:g} Hz")


def _factors(model: Model, weights: Mapping[str, float] | None) -> FloatArray:
    factors = np.ones(len(model.loop.outputs))
    for name, factor in (weights or {}).items():
        own = [i for i, out in enumerate(model.loop.outputs) if out == name or out.startswith(f"{name}.")]
        if not own:
            raise ModelError(
                f"weights: {name} is no channel; expected y, i_c, or one of {', '.join(model.loop.outputs)}"
            )
        if not (np.isfinite(factor) and factor >= 0.0):
            raise ModelError(f"weights: {name} = {factor}; expected a number of 0 or more")
        factors[own] = factor
    if not factors.any():
        raise ModelError("weights: every channel has weight 0; leave at least one in")
    return factors


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


def _starts(theta: FloatArray, free: list[int], limits: Limits, count: int, seed: int) -> list[FloatArray]:
    random = np.random.default_rng(seed)
    factors = [np.ones(len(free)), *np.exp(0.3 * random.standard_normal((count - 1, len(free))))]
    return [theta[free] * factor for factor in factors]


def _best_of(problem: Problem, starts: list[FloatArray], limits: Limits, max_evaluations: int) -> tuple[End, list[str]]:
    ends, unstable = [], None
    for start in starts:
        x = np.clip(start / problem.scale, *limits)
        try:
            problem.normal_equations(x)
        except UnstableLoopError as error:
            unstable = error
            continue
        ends.append(problem.descend(x, limits, max_evaluations))
        if ends[-1].status == "stopped":
            break
    notes = []
    if not ends:
        found = _stable_start(problem, limits)
        if found is None:
            raise UnstableLoopError(
                f"the closed loop is unstable at the start values ({unstable}), and at all others that were tried "
                f"around them. Check the controller, the signs and sizes of K_i and K_s, and the time constants in "
                f"{problem.model.rig.path or 'the rig'}."
            )
        x, moved = found
        notes.append(f"the loop is unstable at the start values; started from {moved} of them instead")
        ends.append(problem.descend(x, limits, max_evaluations))
    best = min(ends, key=lambda end: end.cost)
    if len(starts) > 1:
        same = sum(end.cost < best.cost * (1.0 + 1e-6) for end in ends)
        notes.append(f"{same} of {len(starts)} starts ended at this optimum, {len(starts) - len(ends)} were unstable")
    return best, notes


def _stable_start(problem: Problem, limits: Limits) -> tuple[FloatArray, str] | None:
    """The nearest start that is stable, among common factors of all K_i, all K_s and all time constants."""
    kinds = {kind: [k for k, i in enumerate(problem.free) if problem.model.names[i].startswith(kind)] for kind in UNITS}
    factors = product(*((STABLE_FACTORS if members else (1.0,)) for members in kinds.values()))
    for trial in sorted(factors, key=lambda trial: np.sum(np.log(trial) ** 2)):
        x = problem.model.theta[problem.free] / problem.scale
        for members, factor in zip(kinds.values(), trial, strict=True):
            x[members] *= factor
        x = np.clip(x, *limits)
        if problem.model.with_theta(problem.theta(x)).is_stable:
            used = [f"{f:g} times {kind}" for (kind, members), f in zip(kinds.items(), trial, strict=True) if members]
            return x, ", ".join(used)
    return None


def _estimate(problem: Problem, end: End, limits: Limits, notes: list[str], begun: float) -> Estimate:
    model, free = problem.model, problem.free
    simulated, covariance = _spread(problem, end.theta)
    sizes = np.maximum(np.abs(end.theta[free]), problem.scale)
    relative = covariance / np.outer(sizes, sizes)
    directions = _unknown(relative, [model.names[i] for i in free])
    lost = {name for direction in directions for name in direction}
    deviation = np.sqrt(np.diag(covariance))
    parameters = {}
    for k, i in enumerate(free):
        name, value, sd = model.names[i], float(end.theta[i]), float(deviation[k])
        unit = model.parameters[i].unit
        if name in lost:
            parameters[name] = ParameterEstimate(None, None, None, unit)
            covariance[k, :] = covariance[:, k] = np.nan
        else:
            interval = (value - NORMAL_95 * sd, value + NORMAL_95 * sd)
            parameters[name] = ParameterEstimate(value, sd, interval, unit)
    if end.status == "at_bound":
        x = end.theta[free] / problem.scale
        touches = (np.abs(x - limits[0]) < 1e-3) | (np.abs(x - limits[1]) < 1e-3)
        at = [model.names[i] for i, touched in zip(free, touches, strict=True) if touched]
        notes = [*notes, f"at a bound: {', '.join(at)}"]
    records = problem.records
    channels = [c for c in records[0].channels if all(c in r.channels for r in records)]
    return Estimate(
        model=model.with_values(dict(zip(model.names, end.theta, strict=True))),
        parameters=parameters,
        covariance=covariance,
        fit_percent=fit_percent(channels, [r.outputs for r in records], simulated),
        noise_ceiling_percent=pooled_ceiling(records, channels),
        status="not_identifiable" if directions else end.status,
        evaluations=problem.evaluations,
        seconds=time.perf_counter() - begun,
        records=records,
        simulated=simulated,
        directions=directions,
        notes=(*(note for record in records for note in record.notes), *notes),
    )


def _spread(problem: Problem, theta: FloatArray) -> tuple[tuple[FloatArray, ...], FloatArray]:
    """Simulated outputs of each record, and the covariance of the free parameters."""
    size = len(problem.free)
    at_end = problem.model.with_theta(theta)
    hessian, score, simulated = np.zeros((size, size)), np.zeros((size, size)), []
    for record, weight in zip(problem.records, problem.weights, strict=True):
        y, jacobian = at_end.sensitivity(record, problem.free)
        simulated.append(y)
        used = weight > 0.0
        residual = (padded_outputs(record) - y)[:, used] * weight[used]
        jacobian = jacobian[:, used] * (weight[used, None] * problem.scale)
        residual -= residual.mean(axis=0)
        jacobian -= jacobian.mean(axis=0)
        lines = jacobian.reshape(-1, size)
        hessian += lines.T @ lines
        way = loop_noise(at_end.at(record), record.samples, len(weight))[:, used][:, :, used] * weight[used, None]
        score += score_covariance(residual, jacobian, way)
    # where no output moves, the score does not scatter either, and the sandwich alone would claim perfect knowledge
    inverse, unseen = _inverse(hessian)
    relative = inverse @ score @ inverse + UNSEEN_VARIANCE * unseen @ unseen.T
    return tuple(simulated), relative * np.outer(problem.scale, problem.scale)


def _inverse(hessian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverse in the directions that move the outputs, and the directions that do not, shape (free, unseen)."""
    values, vectors = np.linalg.eigh(hessian)
    seen = values > values[-1] * 1e-13
    return (vectors[:, seen] / values[seen]) @ vectors[:, seen].T, vectors[:, ~seen]


def _unknown(relative: FloatArray, names: list[str]) -> list[dict[str, float]]:
    """Combinations of parameters, as relative changes, that the records do not determine."""
    values, vectors = np.linalg.eigh(relative)
    unknown = vectors[:, np.sqrt(np.maximum(values, 0.0)) > WHOLLY_UNKNOWN]
    found = []
    for vector in unknown.T:
        vector = vector / vector[np.argmax(np.abs(vector))]
        found.append({name: float(v) for name, v in zip(names, vector, strict=True) if abs(v) > 0.05})
    return found
