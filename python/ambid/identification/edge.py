"""The edge of stability: whether a fit has run into it, and what is to be known of one that ends there or near it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.damped import UNFELT
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import End, is_barred
from ambid.noise import Comparison

AT_EDGE = 1e-3
"""Rate of decay below which a fit has run into the edge of stability, where no record can have been made [1/s]."""
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


def is_at_edge(problem: WhitenedProblem, end: End) -> bool:
    """Whether a fit was driven to the edge of stability, which keeps it from its optimum."""
    if end.status != "converged":
        return False
    return problem.model.with_theta(end.theta).decay_rate < AT_EDGE or problem.is_stuck(end.theta)


def findings_at_edge(comparison: Comparison, problem: WhitenedProblem, end: End) -> Iterator[Finding]:
    """What is to be known of a fit that ended at the edge of stability, or near it."""
    durations = [part.record.samples / part.record.sample_rate for part in comparison.noise.in_time]
    if not durations:
        return
    decay = comparison.model.decay_rate
    form, scale = comparison.noise.quadratic(comparison.model, problem.free), problem.scale
    if end.status == "converged" and is_barred(form.hessian * np.outer(scale, scale), form.gradient * scale, form.cost):
        yield BARRED(NOWHERE, decay_rate_1_s=decay)
    elif decay * max(durations) < UNFELT:
        yield NEAR_EDGE(NOWHERE, decay_rate_1_s=decay, fades=decay * max(durations))
