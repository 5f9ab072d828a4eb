"""Where descents start: spread around the given values, inside the stable region; and which of their ends counts."""

from collections.abc import Generator
from itertools import product

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import UnstableLoopError, UnstableStartError
from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.problem import EXACTLY, Descent, End, LeastSquares, Limits
from ambid.model import Model
from ambid.model.parameter import UNITS

STABLE_FACTORS = (0.3, 0.45, 0.65, 0.8, 1.0, 1.25, 1.5)
"""Where the start is unstable, these multiples of the start values are tried."""
STOPPED_AT = Kind("stopped_at_start", "note", "stopped at start {start} of {starts}")
MOVED = Kind(
    "unstable_start", "warning", "the loop is unstable at the start values; started from them times {factors:g}"
)
COMPARED = Kind("starts_compared", "note", "{same} of {starts} starts ended at this optimum, {unstable} were unstable")


def spread_starts(theta: FloatArray, free: list[int], count: int, seed: int) -> list[FloatArray]:
    """`count` starts, the first at `theta`, the others at random factors of it, spread by about 30 %."""
    random = np.random.default_rng(seed)
    factors = [np.ones(len(free)), *np.exp(0.3 * random.standard_normal((count - 1, len(free))))]
    return [theta[free] * factor for factor in factors]


def best_of(
    problem: LeastSquares, starts: list[FloatArray], limits: Limits, max_evaluations: int, step: float = EXACTLY
) -> Generator[Descent, End, tuple[End, list[Finding]]]:
    """The best end of descents from these starts, and what is to be known of them."""
    ends: list[End] = []
    found: list[Finding] = []
    try:
        for start in starts:
            x = np.clip(start / problem.scale, *limits)
            try:
                problem.normal_equations(x)
            except UnstableLoopError:
                continue
            ends.append((yield Descent(problem, x, limits, max_evaluations, step)))
            if ends[-1].status == "stopped":
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        if not ends:
            raise
        found.append(STOPPED_AT(NOWHERE, start=len(ends), starts=len(starts)))
        return min(ends, key=lambda end: end.cost)._replace(status="stopped"), found
    if not ends:
        x, moved = _stable_start(problem.model, problem.free, limits)
        found.append(moved)
        ends.append((yield Descent(problem, x, limits, max_evaluations, step)))
    best = min(ends, key=lambda end: end.cost)
    if len(starts) > 1:
        same = sum(end.cost < best.cost * (1.0 + 1e-6) for end in ends)
        found.append(COMPARED(NOWHERE, same=same, starts=len(starts), unstable=len(starts) - len(ends)))
    return best, found


def stable_model(
    model: Model, free: list[int], origins: list[FloatArray], limits: Limits
) -> tuple[Model, list[Finding]]:
    """The model at the first stable start, and what was moved to find one, if that was needed."""
    scale = np.array([model.parameters[i].scale for i in free])
    for start in origins:
        theta = model.theta
        theta[free] = np.clip(start / scale, *limits) * scale
        if model.with_theta(theta).may_stand:
            return model.with_theta(theta), []
    x, moved = _stable_start(model, free, limits)
    theta = model.theta
    theta[free] = x * scale
    return model.with_theta(theta), [moved]


def _stable_start(model: Model, free: list[int], limits: Limits) -> tuple[FloatArray, Finding]:
    """The nearest start that is stable, among common factors of all K_i, all K_s and all time constants.

    Raises
    ------
    UnstableStartError
        If there is none.
    """
    scale = np.array([model.parameters[i].scale for i in free])
    kinds = {kind: [k for k, i in enumerate(free) if model.names[i].startswith(kind)] for kind in UNITS}
    factors = product(*((STABLE_FACTORS if members else (1.0,)) for members in kinds.values()))
    for trial in sorted(factors, key=lambda trial: np.sum(np.log(trial) ** 2)):
        x = model.theta[free] / scale
        for members, factor in zip(kinds.values(), trial, strict=True):
            x[members] *= factor
        x = np.clip(x, *limits)
        theta = model.theta
        theta[free] = x * scale
        if model.with_theta(theta).may_stand:
            used = {kind: factor for (kind, members), factor in zip(kinds.items(), trial, strict=True) if members}
            return x, MOVED(NOWHERE, factors=used)
    try:
        model.loop.simulate(model.theta, np.zeros((1, len(model.loop.inputs))))
        why = ""
    except UnstableLoopError as error:
        why = f" ({error})"
    raise UnstableStartError(
        f"the closed loop is unstable at the start values{why}, and at all others that were tried around them. Check "
        f"the controller, the signs and sizes of K_i and K_s, and the time constants in {model.rig.path or 'the rig'}."
    )
