"""Candidates against each other: each added and refitted, and those that do as well as the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ambid.diagnosis.candidates import Candidate
from ambid.diagnosis.state import State, Task, nominal_with_effects_of
from ambid.effects import Effect
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import ROUGHLY, criterion, refit
from ambid.model import Model
from ambid.noise import Comparison

__all__ = ["Refitted", "alternatives", "is_as_good", "is_driven_off", "reconsidered", "refits"]

EQUALLY_GOOD = 9.2
"""Candidates whose criterion is within this of the best cannot be told apart (99 % of a chi-squared with 2 dof)."""
APART = 2.33
"""Standard deviations of J1 - J2 that tell two rivals apart: chance brings more in one of a hundred records."""
ENOUGH = (2.0 * (APART + 1.645)) ** 2
"""Evidence lambda that tells two effects apart in 95 % of records, 63: J1 - J2 has the mean lambda and the standard
deviation 2 sqrt(lambda), and only what is beyond `APART` of these counts."""
FAR_OFF = 20.0
"""Misfit J/dof of a base model above which refits start from the rig file's values too."""
LIKE = 0.99
"""Part of a variant's score that another must have for both to be refitted; of a base model that is far off, none."""

Refitted = tuple[Candidate, Comparison]


def refits(task: Task, state: State, tried: Sequence[Candidate], *, whatever_promised: bool = False) -> list[Refitted]:
    """Each candidate added and refitted, the best first.

    They start from the predicted values; where the base model is far off, from the rig file's too. One that promises
    far too little is passed over, but for those `whatever_promised`.
    """
    found: list[Refitted] = []
    for done, candidate in enumerate(tried):
        task.progress(f"refitting {candidate.effect.name}", done, len(tried))
        best = min((other.cost for _, other in found), default=np.inf)
        is_enough = whatever_promised or state.fit.cost - 2.0 * candidate.score <= best + EQUALLY_GOOD
        if best < state.at_noise and not is_enough:
            continue  # even twice the predicted fall would not do
        starts = [(state.fit.model, candidate.start)]
        if candidate.from_start or state.fit.cost > FAR_OFF * state.dof or is_driven_off(task, state.fit.model):
            starts.append((nominal_with_effects_of(task, state.fit.model), candidate.start))
        if whatever_promised:
            far = candidate.effect.far_starts(state.fit.model.home_of(candidate.effect) or state.fit.model.rig)
            starts += [(state.fit.model, dict(values)) for values in far]
        starts.append((state.fit.model, {}))  # typical small values, where the predicted ones make no stable loop
        ends: list[Comparison] = []
        for base, values in starts:
            try:
                ends.append(refit(state.fit.of(base.add(candidate.effect, values)), step=ROUGHLY))
            except (UnstableLoopError, ModelError, ValueError):
                continue
            if ends[-1].cost < state.at_noise or len(ends) == len(starts) - 1:
                break
        if ends:
            found.append(_best_variant(state, candidate, min(ends, key=lambda end: end.cost)))
    return sorted(found, key=lambda pair: criterion(pair[1]))


def _best_variant(state: State, candidate: Candidate, fit: Comparison) -> Refitted:
    """The candidate, or the variant of it that does better once it is refitted."""
    found = (candidate, fit)
    is_far_off = state.fit.cost > FAR_OFF * state.dof
    for effect, values, share in candidate.near:
        if not is_far_off and share < LIKE:
            continue
        try:
            other = refit(state.fit.of(state.fit.model.add(effect, values)), step=ROUGHLY)
        except (UnstableLoopError, ModelError, ValueError):
            continue
        if criterion(other) < criterion(found[1]):
            found = (replace(candidate, effect=effect, start=values), other)
    return found


def alternatives(order: Sequence[Refitted]) -> tuple[str, ...]:
    """Names of the candidates that do as well as the best; none that only contains a simpler one of them."""
    best = order[0][1]
    equal = [candidate.effect for candidate, other in order if is_as_good(other, best)]
    names = {effect.name for effect in equal}
    return tuple(effect.name for effect in equal if not names & set(effect.contains))


def is_as_good(other: Comparison, best: Comparison) -> bool:
    """Whether chance can make the difference between two models of the same records.

    Rivals are not nested: where two are as good as each other, J1 - J2 has the variance 4 |r1 - r2|^2 of their
    whitened residuals (Vuong, Econometrica 57 (1989) 307), times J/dof where misfit is left. That one takes more
    parameters to say the same puts it behind, but is no evidence against it.
    """
    apart = other.residual - best.residual
    chance = 2.0 * APART * np.sqrt(float(apart @ apart) * max(1.0, best.misfit))
    return bool(min(criterion(other) - criterion(best), other.cost - best.cost) <= max(chance, EQUALLY_GOOD))


def reconsidered(state: State, effect: Effect) -> tuple[State, str]:
    """The state with the best of an effect's rivals beside all that was added after it, and the name of that."""
    rest = state.fit.model.without(effect.name)
    here = {other.name for other in rest.effects}
    found: list[Refitted] = []
    for rival in state.rivals[effect.name]:
        if rival.effect.name == effect.name:
            found.append((rival, state.fit))
        elif rival.effect.name not in here:
            try:
                found.append((rival, refit(state.fit.of(rest.add(rival.effect, rival.start)), step=ROUGHLY)))
            except (UnstableLoopError, ModelError):
                continue
    order = sorted(found, key=lambda pair: criterion(pair[1]))
    best, fit = order[0]
    sets = state.without_set(effect.name) | {best.effect.name: alternatives(order)}
    fit = fit if best.effect.name == effect.name else refit(fit)
    return replace(state, fit=fit, sets=sets), best.effect.name


def is_driven_off(task: Task, model: Model) -> bool:
    """Whether a parameter of the base model has left its start by more than a factor of two."""
    now = {p.name: p.value for p in model.parameters}
    start = {p.name: p.value for p in task.nominal.parameters if p.name in now and p.value > 0.0}
    return any(not 0.5 < now[name] / value < 2.0 for name, value in start.items())
