"""Fits in the noise of their own residual: ways around obstacles, such as the edge of stability, and likelier ends."""

from collections.abc import Generator, Iterator, Sequence

import numpy as np

from ambid.errors import UnstableLoopError
from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.damped import UNFELT, NearStart, damped_start
from ambid.identification.minimum import WhitenedProblem, other_side
from ambid.identification.problem import (
    NEAR,
    ROUGHLY,
    UNDERSTATED,
    Descent,
    End,
    Limits,
    gone,
    is_barred,
    promised_fall,
)
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.known import known_residual
from ambid.record import Record

MOST_RENEWALS = 3
"""So often is the noise taken from the residual again, at the most."""
RENEWED = 1e-3
"""Part of what is left above the noise by which J may fall in the noise renewed, where physics is missing."""
AT_EDGE = 1e-3
"""Rate of decay below which a fit has run into the edge of stability, where no record can have been made [1/s]."""
Renewed = tuple[WhitenedProblem, End, Comparison]
BARRED = Kind(
    "stopped_at_edge_of_stability",
    "warning",
    "the fit stopped at the edge of stability: the slowest mode of the estimated loop decays at {decay_rate_1_s:.2g} "
    "1/s, and the model would fit better beyond the edge, so that this may not be the optimum",
    "use several starts, or record longer",
)
NEAR_EDGE = Kind(
    "near_edge_of_stability",
    "note",
    "the slowest mode of the estimated loop decays by {fades:.2g|%} during the longest record, at "
    "{decay_rate_1_s:.2g} 1/s: these records hardly distinguish it from a mode that grows",
    "record longer, where the damping matters",
)


def renewed(
    rough: WhitenedProblem, best: End, model: Model, free: list[int], limits: Limits, most: int
) -> Generator[Descent, End, Renewed]:
    """The optimum of J near an end, in the noise of its own residual.

    The noise estimated with a model depends on it: with periods through the way that it takes round the loop, and
    through tones; without them altogether. It is taken from the residual again until the optimum stays where it is: J,
    in the noise that the optimum leaves itself, falls no further, or promises not to.
    """
    comparison = Comparison(model.with_theta(best.theta), rough.noise.records, rough.noise).renewed()
    problem = rough.in_noise(comparison.noise, model, free)
    for _ in range(1 + MOST_RENEWALS):
        if best.status == "stopped":
            break
        best = yield Descent(problem, best.theta[free] / problem.scale, limits, most)
        if (behind := other_side(problem, best.theta)) is not None:
            other = yield Descent(problem, behind[free] / problem.scale, limits, most)
            best = min(best, other, key=lambda end: end.cost)
        fit = comparison.of(model.with_theta(best.theta))
        has_all_tones, fell = not fit.noise.misses_tone(fit.model), comparison.cost - fit.cost
        comparison = fit.renewed()
        problem = problem.in_noise(comparison.noise, model, free)
        least = hardly(comparison)
        if has_all_tones and (fell < least or problem.promise(best.theta) < least):
            break
    return problem, best, comparison


def hardly(comparison: Comparison) -> float:
    """Fall of J below which an optimum stays where it is."""
    return max(NEAR, RENEWED * (comparison.cost - comparison.dof))


def stays(comparison: Comparison) -> bool:
    """Whether an optimum of other noise is one of this, too."""
    return WhitenedProblem(comparison.model, comparison.noise).promise(comparison.model.theta) < hardly(comparison)


def improbability(comparison: Comparison) -> float:
    """Minus twice the logarithm of the likelihood of a model with the noise of its own residual, but for a constant.

    Beside J it has the determinants of S, which models with noise of their own do not share; what is left above the
    noise counts by its witnesses, see `noise.known`.
    """
    noise, known = comparison.noise, known_residual(comparison.model)
    gain = sum(float(np.linalg.slogdet(part.whitening)[1].sum()) for part in noise.in_time)
    beforehand = float(known @ known)
    left = comparison.cost - beforehand
    size = noise.size
    if left > size.numbers:
        left = size.numbers + size.witnesses * float(np.log(size.variance(left)))
    return left + beforehand - 4.0 * gain


def way_around(
    rough: WhitenedProblem, best: End, stable: Model, records: tuple[Record, ...], limits: Limits, most: int
) -> Generator[Descent, End, End]:
    """A better end of a rough fit that a bound or the edge of stability kept away: where all is damped more."""
    at_edge = is_at_edge(rough, best)
    if not at_edge and best.status != "at_bound":
        return best
    try:
        x, spent = damped_start(stable, records, rough.free, limits, NearStart if at_edge else WhitenedProblem)
    except UnstableLoopError:
        return best  # records of no such loop drive it to the edge all the same
    rough.evaluations += spent
    near = NearStart(stable, rough.noise, rough.free, rough.progress) if at_edge else rough
    second = yield Descent(near, x, limits, most, ROUGHLY)
    if near is not rough:
        rough.evaluations += near.evaluations
    return min(best, second, key=lambda end: end.cost)


def around_edge(fit: Comparison, bound: float = np.inf, most: int = 40) -> Comparison:
    """A refit of a linear model that the edge of stability kept from its optimum: where all is damped more.

    None that promises to stay above a bound, at which descents end too.
    """
    model, records = fit.model, tuple(part.record for part in fit.noise.in_time)
    if not records or not model.is_linear or model.decay_rate * _longest(records) > UNFELT:
        return fit
    problem = WhitenedProblem(model, fit.noise, roughly=True)
    promised = problem.promise(model.theta)
    if fit.cost - UNDERSTATED * promised > bound or not is_barred(promised, fit.cost):
        return fit
    lower, upper = np.array([(p.lower, p.upper) for p in model.parameters]).T / problem.scale
    end = gone(way_around(problem, End(model.theta, fit.cost, "converged"), model, records, (lower, upper), most))
    return fit.of(model.with_theta(end.theta))


def _longest(records: Sequence[Record]) -> float:
    """Duration of the longest record [s]."""
    return max(record.samples / record.sample_rate for record in records)


def is_at_edge(problem: WhitenedProblem, end: End) -> bool:
    """Whether a fit was driven to the edge of stability, which keeps it from its optimum."""
    if end.status != "converged":
        return False
    is_stuck = is_barred(problem.promise(end.theta), end.cost)
    return is_stuck or _stands(problem.model.with_theta(end.theta)).decay_rate < AT_EDGE


def _stands(model: Model) -> Model:
    """The model as it stands: at rest, or without its nonlinear effects, as friction that slips."""
    return model if model.is_stable else model.without_nonlinear()


def findings_at_edge(comparison: Comparison, problem: WhitenedProblem, end: End) -> Iterator[Finding]:
    """What is to be known of a fit that ended at the edge of stability, or near it."""
    records = [part.record for part in comparison.noise.in_time]
    if not records:
        return
    decay = _stands(comparison.model).decay_rate
    form, scale = comparison.noise.quadratic(comparison.model, problem.free), problem.scale
    promised = promised_fall(form.hessian * np.outer(scale, scale), form.gradient * scale)
    if end.status == "converged" and is_barred(promised, form.cost):
        yield BARRED(NOWHERE, decay_rate_1_s=decay)
    elif decay * _longest(records) < UNFELT:
        yield NEAR_EDGE(NOWHERE, decay_rate_1_s=decay, fades=decay * _longest(records))
