"""Closed-loop identification (CLI): the parameters that make the simulated loop follow the measured one (eq. 9)."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import ModelError, RecordError, Stopped
from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.covariance import budget, covariance, propagated, sandwich
from ambid.identification.curvature import Curvature, curvature, with_curvature
from ambid.identification.estimate import Estimate, ParameterEstimate
from ambid.identification.identifiability import identifiability, judged
from ambid.identification.minimum import WhitenedProblem, resolved
from ambid.identification.preparation import Prepared, beside_known, prepare
from ambid.identification.problem import ROUGHLY, Descent, End, LeastSquares, Limits, Problem, gone, noise_levels
from ambid.identification.renewal import findings_at_edge, improbability, is_at_edge, renewed, way_around
from ambid.identification.starts import best_of, stable_model
from ambid.identification.tolerances import budget_by_name, findings_of, known_values
from ambid.model import Given, Model
from ambid.noise import Adequacy, Comparison, Noise, compare
from ambid.record import Record, Source
from ambid.rig.notes import notes_of
from ambid.threads import with_one_blas_thread

LIKELIHOOD, EQ_9 = "likelihood", "eq9"
INCONSISTENT = Kind(
    "intervals_widened",
    "warning",
    "physics is missing, and the intervals are widened by the residual; they may not contain the true values, where "
    "what is missing moves the parameters further",
)
WITHOUT_NOISE = Kind(
    "noise_unknown", "note", "weights of eq. 9, since the noise at DFT frequencies is not known: {reason}"
)
WITHOUT_PERIODS = Kind(
    "noise_not_separable",
    "warning",
    "[weights of {weights}: ]physics is missing, and without periods the noise cannot be separated from what is "
    "missing: the misfit {misfit:.3g} (J/dof) is a lower limit",
    "excite periodically",
)
AT_BOUND = Kind(
    "parameter_at_bound",
    "warning",
    "at a bound: {parameters} = {value:.4g}[ {unit}], the {end} value allowed: the data ask for one beyond it, or do "
    "not determine it",
    "diagnose the records where physics is missing; else fix {parameters} at a known value (--fix), correct its "
    "bounds, or, for a lag, excite at higher frequencies",
)
LARGEST_WEIGHT = 1e6
"""Of a channel; its square still leaves digits to a channel of weight 1."""


class Found(NamedTuple):
    """What an identification ends with."""

    problem: LeastSquares
    end: End
    limits: Limits
    covariance: FloatArray
    budget: FloatArray
    directions: list[dict[str, float]]
    comparison: Comparison
    findings: list[Finding]
    curvature: Curvature | None = None

    def curved(self) -> Found:
        """This, held against the force law of a single magnet; the covariance allows for what that moves."""
        comparison, free = self.comparison, self.problem.free
        if not comparison.is_judged or self.directions or self.end.status == "stopped":
            return self
        if (found := curvature(comparison, free, self.limits, self.covariance)) is None:
            return self
        return self._replace(covariance=self.covariance + np.outer(found.shift, found.shift), curvature=found)

    @property
    def misfit(self) -> float:
        """J/dof."""
        return self.comparison.misfit

    @property
    def adequacy(self) -> Adequacy:
        """As `Estimate.adequacy`."""
        return with_curvature(self.comparison.adequacy, self.curvature)

    @property
    def status(self) -> str:
        """One of `estimate.STATUS`."""
        return "not_identifiable" if self.directions else self.end.status

    @property
    def unknown(self) -> set[str]:
        """Parameters that the records do not determine."""
        return {name for direction in self.directions for name in direction}


Steps = Generator[Descent, End, Found]
"""An identification that waits for whoever runs its descents: alone, or beside those of others."""


@with_one_blas_thread
def identify(
    model: Given,
    records: Source | Sequence[Source],
    *,
    free: str | Iterable[str] | None = None,
    fixed: str | Iterable[str] | Mapping[str, float] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    weights: str | Mapping[str, float] = LIKELIHOOD,
    starts: int = 1,
    seed: int = 0,
    max_evaluations: int = 100,
    progress: Callable[[int, float], None] | None = None,
) -> Estimate:
    """Fit the free parameters of a closed-loop model to records.

    By default the misfit J of the lines of the spectrum in units of their noise is minimised, which is maximum
    likelihood; what the rotor did at the first sample is fitted too, so that a record may begin anywhere. With
    ``weights="eq9"`` it is the paper's least squares in time: the loop is simulated from rest, means are removed per
    record and channel, and residuals are weighted by the noise of their channel, its scatter over the periods, or,
    without periods, the residual of a first fit.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        Start values; a rig means its nominal values.
    records : Record or FrequencyResponse, path of a file, or sequence of them
        Of this rig; records in time all with the same axes and sample rate.
    free : str or iterable of str, optional
        Names or patterns such as ``K_i`` or ``K_s.A_*``; default all.
    fixed : str, iterable of str, or mapping of str to float
        Names or patterns that keep their start values, or the values that are given, such as ``{"tau_e": 2e-4}``.
    bounds : mapping of str to (float, float), optional
        By name or pattern, SI units; default positive.
    weights : str or mapping of str to float
        ``likelihood`` or ``eq9``; or eq. 9 with further factors for the signals ``y`` and ``i_c``, or single channels
        such as ``y.A_zeta``; 0 leaves them out. Where the noise on lines is not known, since the record is too short or
        holds none, it is eq. 9, and a finding states it. Eq. 9 is for records in time alone.
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
    Stopped
        At Ctrl-C during a fit, with the best so far; it is a KeyboardInterrupt.
    """
    begun = time.perf_counter()
    own = steps(
        model,
        records,
        free=free,
        fixed=fixed,
        bounds=bounds,
        weights=weights,
        starts=starts,
        seed=seed,
        max_evaluations=max_evaluations,
        progress=progress,
    )
    return _estimate(gone(own), begun)


def steps(
    model: Given,
    records: Source | Sequence[Source],
    *,
    free: str | Iterable[str] | None = None,
    fixed: str | Iterable[str] | Mapping[str, float] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    weights: str | Mapping[str, float] = LIKELIHOOD,
    starts: int = 1,
    seed: int = 0,
    max_evaluations: int = 100,
    progress: Callable[[int, float], None] | None = None,
) -> Steps:
    """The identification that `identify` describes, descent by descent."""
    if isinstance(weights, str) and weights not in (LIKELIHOOD, EQ_9):
        raise ModelError(f"weights = {weights!r}; expected {LIKELIHOOD!r}, {EQ_9!r}, or factors by channel")
    prepared = prepare(model, records, free, fixed, bounds, starts, seed, max_evaluations)
    in_time, has_responses = prepared.in_time, len(prepared.in_time) < len(prepared.records)
    found: list[Finding] = []
    if weights == LIKELIHOOD:
        try:
            return (yield from _likeliest(prepared, max_evaluations, progress))
        except RecordError as error:
            if has_responses:
                raise  # frequency responses have no eq. 9
            found.append(WITHOUT_NOISE(NOWHERE, reason=str(error)))
    if has_responses:
        raise ModelError(
            f"weights = {weights!r}: eq. 9 is least squares in time, and frequency responses are among the records; "
            "leave weights out, or them"
        )
    if free_response := next((record for record in in_time if record.is_free_response), None):
        raise RecordError(
            f"{free_response.path or free_response.name}: nothing drives this record, and eq. 9 simulates from rest; "
            f"{found[0].message if found else 'leave the weights out'}"
        )
    factors = _factors(prepared.model, in_time, None if isinstance(weights, str) else weights)
    return (yield from _in_time(prepared, factors, max_evaluations, progress, found))


def _in_time(
    prepared: Prepared,
    factors: Mapping[str, float],
    max_evaluations: int,
    progress: Callable[[int, float], None] | None,
    before: list[Finding],
) -> Steps:
    """The fit of eq. 9, as if the values that are known to a tolerance were exact; their errors widen its intervals."""
    model, _, records, free, limits, origins, known = prepared
    problem = Problem(model, records, free, noise_levels(records), factors, progress)
    best, findings = yield from best_of(problem, origins, limits, max_evaluations)
    if not all(record.periods >= 3 for record in records):
        # without a scatter over periods the first fit's residual is the noise
        problem = problem.with_noise(problem.residual_rms(best.theta))
        best, more = yield from best_of(problem, [best.theta[problem.free]], limits, max_evaluations)
        findings += more
    found, at_end = sandwich(problem, best.theta), model.with_theta(best.theta)
    directions, determined = judged(found, at_end, free)
    comparison, findings = compare(at_end, records), [*before, *findings, *determined]
    problem, limits = problem.beside(known), beside_known(limits, model, known)
    total, parts = propagated(problem, best.theta, found)
    return Found(problem, best, limits, total, parts, directions, comparison, findings).curved()


def _likeliest(prepared: Prepared, max_evaluations: int, progress: Callable[[int, float], None] | None) -> Steps:
    """The fit that minimises J, in the noise of its own residual.

    It begins as if the values that are known to a tolerance were exact, and goes on with their errors beside the rest.
    """
    given, records, in_time, exact, sides, origins, known = prepared
    stable, moved = stable_model(given, exact, origins, sides)
    noise = Noise.rough(stable, records)
    steps = resolved(Comparison(stable, records, noise)).structure.substeps
    given, stable = given.with_substeps(steps), stable.with_substeps(steps)
    rough = WhitenedProblem(given, noise, exact, progress)  # x in units of the limits
    best, more = yield from best_of(
        rough, origins if not moved else [stable.theta[exact]], sides, max_evaluations, ROUGHLY
    )
    has_eq_9 = len(in_time) == len(records) and not any(record.is_free_response for record in in_time)
    if in_time and best.status in ("converged", "at_bound"):
        best = yield from way_around(rough, best, stable, in_time, sides, max_evaluations)
    free, limits = [*exact, *known], beside_known(sides, given, known)
    model = given.opened()
    problem, best, comparison = yield from renewed(rough, best, model, free, limits, max_evaluations)
    if in_time and is_at_edge(problem, best):  # with errors of the rig file it may lead on
        best = yield from way_around(problem, best, comparison.model, in_time, limits, max_evaluations)
        problem, best, comparison = yield from renewed(problem, best, model, free, limits, max_evaluations)
    is_known = all(part.noise_is_measured for part in comparison.noise.parts)
    missing = not is_known and comparison.misfit > comparison.bound
    if missing and has_eq_9 and best.status != "stopped":
        other = yield from _in_time(prepared, _factors(given, in_time, None), max_evaluations, progress, [])
        again = yield from renewed(rough, other.end, model, free, limits, max_evaluations)
        problem, best, comparison = min((problem, best, comparison), again, key=lambda own: improbability(own[2]))
        if other.end.status == "stopped" or improbability(other.comparison) < improbability(comparison):
            why = WITHOUT_PERIODS(NOWHERE, misfit=other.misfit, weights="eq. 9")
            return other._replace(findings=[why, *other.findings])
    directions, determined = identifiability(comparison, exact)
    findings = [*moved, *more, *determined, *findings_at_edge(comparison, problem, best)]
    if missing and comparison.misfit > comparison.bound:
        findings.append(WITHOUT_PERIODS(NOWHERE, misfit=comparison.misfit, weights=None))
    total, parts = covariance(comparison, free), budget(comparison, free)
    return Found(problem, best, limits, total, parts, directions, comparison, findings).curved()


def _factors(model: Model, records: Sequence[Record], weights: Mapping[str, float] | None) -> dict[str, float]:
    """By channel."""
    factors = dict.fromkeys(model.rig.outputs, 1.0)
    for name, factor in (weights or {}).items():
        own = [out for out in factors if out == name or out.startswith(f"{name}.")]
        if not own:
            raise ModelError(f"weights: {name} is no channel; expected y, i_c, or one of {', '.join(factors)}")
        if factor != 0.0 and not 1.0 / LARGEST_WEIGHT <= factor <= LARGEST_WEIGHT:
            raise ModelError(
                f"weights: {name} = {factor}; expected 0, or a number from {1.0 / LARGEST_WEIGHT:g} to "
                f"{LARGEST_WEIGHT:g}"
            )
        factors |= dict.fromkeys(own, factor)
    if not any(factors[name] for record in records for name in record.channels):
        raise ModelError("weights: every channel has weight 0; leave at least one in")
    return factors


def _estimate(found: Found, begun: float) -> Estimate:
    problem, end, limits, covariance, _, directions, comparison, findings, curved = found
    model, free, unknown = problem.model, problem.free, found.unknown
    parameters = {}
    for k, i in enumerate(free):
        name, unit = model.names[i], model.parameters[i].unit
        if model.parameters[i].prior is not None:
            continue
        if name in unknown:
            parameters[name] = ParameterEstimate(None, None, None, unit)
            covariance[k, :] = covariance[:, k] = np.nan
        else:
            errors = float(np.sqrt(covariance[k, k])), float(np.sqrt(found.budget[k, 0]))
            at_end = replace(model.parameters[i], value=float(end.theta[i]))
            parameters[name] = ParameterEstimate.of(at_end, *errors)
    if end.status == "at_bound":
        x = end.theta[free] / problem.scale
        for end_name, bound in zip(("smallest", "largest"), limits, strict=True):
            for i in np.asarray(free)[(np.abs(x - bound) < 1e-3) & (problem.prior == 0.0)]:
                own = model.parameters[int(i)]
                value, unit = float(end.theta[i]), None if own.unit == "1" else own.unit
                at = AT_BOUND(NOWHERE, parameters=[own.name], value=value, unit=unit, end=end_name)
                findings = [*findings, at]
    if comparison.is_judged and not comparison.is_adequate:
        findings = [*findings, INCONSISTENT(NOWHERE)]
    if curved is not None:
        findings = [*findings, curved.finding()]
    own = [k for k, i in enumerate(free) if model.parameters[i].prior is None]
    whole = np.full((len(model.names),) * 2, np.nan)
    whole[np.ix_(free, free)] = covariance
    tolerances = known_values(comparison.model, whole, free)
    findings = [*findings, *notes_of(model.rig), *findings_of(model.rig, tolerances)]
    estimate = Estimate(
        model=comparison.model.with_substeps(None).with_covariance(whole),
        parameters=parameters,
        covariance=covariance[np.ix_(own, own)],
        status=found.status,
        evaluations=problem.evaluations,
        seconds=time.perf_counter() - begun,
        comparison=comparison,
        directions=directions,
        curvature=curved,
        tolerances=tolerances,
        variances=budget_by_name([model.names[i] for i in free], tolerances, found.budget),
        findings=(*(finding for own in comparison.records for finding in own.findings), *findings),
    )
    if end.status == "stopped":
        raise Stopped(estimate)
    return estimate
