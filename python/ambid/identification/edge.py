"""The edge of stability: whether a fit has run into it, and what is to be known of one that ends there or near it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.damped import UNFELT
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import End
from ambid.record import Record

__all__ = ["findings_at_edge", "is_at_edge"]

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


def findings_at_edge(problem: WhitenedProblem, end: End, records: Sequence[Record]) -> Iterator[Finding]:
    """What is to be known of a fit to records in time that ended at the edge of stability, or near it."""
    if not records:
        return
    decay = problem.model.with_theta(end.theta).decay_rate
    fades = decay * max(record.samples / record.sample_rate for record in records)
    if end.status == "converged" and problem.is_stuck(end.theta):
        yield BARRED(NOWHERE, decay_rate_1_s=decay)
    elif fades < UNFELT:
        yield NEAR_EDGE(NOWHERE, decay_rate_1_s=decay, fades=fades)
