"""The way from a base model to one with the missing effects: rank, refit the few best, add one, and begin again.

Every function takes a finished step and gives the next; a search that is stopped ends with the last that it gave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from ambid.arrays import ComplexArray
from ambid.diagnosis.candidates import ALPHA, Candidate, Ranking
from ambid.diagnosis.confirmation import stands
from ambid.diagnosis.ranking import rank
from ambid.diagnosis.rivals import EQUALLY_GOOD, Refitted, alternatives, is_driven_off, reconsidered, refits
from ambid.diagnosis.settled import settled
from ambid.diagnosis.state import State, Task, nominal_with_effects_of, noted
from ambid.effects import Effect
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import ROUGHLY, refit
from ambid.noise import Comparison

__all__ = ["add_best", "add_chosen", "begin", "rings_on"]

REFITTED = 5
"""Candidates of a ranking that are refitted at the most."""
MOST_EFFECTS = 5
"""Effects that a search adds at the most."""
LOST = 2.0
"""Misfit J/dof above which parameters that have left their start say nothing."""
MOST_RENEWALS = 3
"""So often is the noise renewed after an effect was added, at the most."""
RENEWED = 0.02
"""Relative change of J by renewing the noise that is small enough."""
NEGLIGIBLE_SHARE = 0.01
"""Part of the explained misfit below which another effect may mend the formula of the first."""
PROMISING_SHARE = 0.1
"""Part of what is left that a score must predict to be worth a refit."""
HOPELESS_SHARE = 0.3
"""A step that explains less than this of what is left does not lead to an explanation."""
FORESEEN = 0.1
"""Part of the fall of J that the score of a mode foresees, at the least, where it answers the excitation."""
RINGS_ON = 0.2
"""Times that a mode decays by e within a record, below which it lasts: so slow is what stands in for a tone, which
does not decay at all: it is known the better, the farther it stands out of the noise. Twice that is not new."""

Ask = Callable[[Ranking, Candidate], bool | Candidate]
"""Shown a ranking and the candidate that is to be added; False ends the search, another candidate is added instead."""


def begin(task: Task, base: Comparison) -> State:
    """The first step: the base model with its ranking."""
    state = State(base=base, reference=base, fit=base)
    return noted(task, state, _ranked(task, state))


def add_best(task: Task, state: State, ask: Ask | None) -> Iterator[State]:
    """Add what the data support most, again and again; then see whether each is still the best of its rivals."""
    for further in _added(task, state, ask):
        yield (state := further)
    for effect in state.added[:-1]:  # the rivals of the last were refitted with all others in the model
        state, best = reconsidered(state, effect)
        if best != effect.name:
            state = noted(task, state, _ranked(task, state), added=best, removed=effect.name)
        yield state


def add_chosen(task: Task, state: State, chosen: Sequence[Effect]) -> Iterator[State]:
    """Add a person's own choice, in this order.

    Raises
    ------
    ModelError
        If an effect cannot be judged on this model, or makes no stable loop.
    """
    for effect in chosen:
        start = nominal_with_effects_of(task, state.fit.model)
        ranking = rank(state.fit, [effect], start=start)
        if not ranking.candidates:
            why = ranking.not_tried.get(effect.name, "it is in the model already")
            raise ModelError(f"{effect.name} cannot be added to this model ({why})")
        order = refits(task, state, ranking.candidates)
        if not order:
            raise ModelError(f"{effect.name}: no stable loop with it was found; leave it out")
        candidate, better = order[0]
        state = _taken(task, state, better, candidate.effect)
        state = noted(task, state, _ranked(task, state), candidate)
        yield state


def _added(task: Task, state: State, ask: Ask | None, *, however_small: bool = False) -> Iterator[State]:
    while len(state.added) < MOST_EFFECTS:
        ranking = state.ranking
        if _is_negligible(state, ranking) and not however_small:
            yield from _to_the_noise(task, state) if ask is None else ()
            return
        tried = _worth_refitting(state, ranking)
        order = [pair for pair in refits(task, state, tried) if _explains(task, state, pair)]
        if not order or order[0][1].cost > state.at_noise:
            is_hopeless = not order or _is_hopeless(state, order[0][1])
            order = _beyond_scores(task, state, tried, only_far=not is_hopeless) or order
        if not order:
            return
        candidate, better = order[0]
        fall = state.fit.cost - better.cost
        promised = max(fall, candidate.score) if better.cost < state.at_noise < state.fit.cost else candidate.score
        if candidate.chance_of(min(fall, promised)) > np.log(ALPHA / len(ranking.candidates)):
            return  # the refit brings less than the score promised
        is_unseen = state.fit.misfit <= state.fit.bound and (however_small or not state.physics)
        if is_unseen and not stands(task, state, order[0]):
            return  # no misfit was left, and the rest of the evidence knows nothing of it
        answer = True if ask is None else ask(ranking, candidate)
        if isinstance(answer, Candidate) and answer is not candidate:
            order = refits(task, state, [answer], whatever_promised=True)
            if not order:
                raise ModelError(f"{answer.effect.name}: no stable loop with it was found; choose another")
            candidate, better = order[0]
        elif not answer:
            return
        elif _is_hopeless(state, better):
            yield replace(state, hopeless=better)
            return
        taken = _taken(task, state, better, candidate.effect)
        if taken.fit.misfit > max(state.fit.misfit, taken.fit.bound):
            return  # held against the noise that it leaves itself, it is worse than nothing
        state = taken
        rivals = {**state.rivals, candidate.effect.name: tuple(other for other, _ in order)}
        sets = {**state.sets, candidate.effect.name: alternatives(order)}
        state = replace(state, rivals=rivals, sets=sets)
        state = noted(task, state, _ranked(task, state), candidate)
        yield state
        for further in _pruned(task, state):
            yield (state := further)


def _is_hopeless(state: State, better: Comparison) -> bool:
    """Whether far more than noise is left, and a step explains little of it."""
    excess = state.fit.cost - state.dof
    return state.fit.cost > state.at_noise and state.fit.cost - better.cost < HOPELESS_SHARE * excess


def _beyond_scores(task: Task, state: State, tried: Sequence[Candidate], *, only_far: bool) -> list[Refitted]:
    """The linear candidates that explain everything once they are refitted, whatever their scores say.

    A score is a derivative where the effect is absent: beside parameters that a large lag or delay has driven off, it
    may be nothing or have the wrong sign. Where another explains much, only those with far starts are tried.
    """
    if state.fit.cost < state.at_noise:
        return []
    model = state.fit.model
    others = [
        c
        for c in state.ranking.candidates
        if (c.effect.far_starts(model.home_of(c.effect) or model.rig) or not only_far and c not in tried)
        and model.add(c.effect, c.start).is_linear
    ]
    found = refits(task, state, others, whatever_promised=True)
    return [pair for pair in found if pair[1].cost < state.at_noise and _explains(task, state, pair)]


def _explains(task: Task, state: State, pair: Refitted) -> bool:
    """Whether a refitted candidate stays within what physics allows and makes no record worse that was kept back."""
    candidate, better = pair
    own = (p for p in better.model.parameters if p.name.startswith(f"{candidate.effect.name}."))
    is_foreseen = candidate.score > FORESEEN * (state.fit.cost - better.cost)  # by its answer to the excitation
    stands_in = not is_foreseen and _has_more_modes(state.fit, better) and rings_on(state.fit, better)
    return not any(p.is_at_limit for p in own) and not stands_in and not _rises(task, state, better)


def _has_more_modes(before: Comparison, after: Comparison) -> bool:
    counts = [len(own.model.without_nonlinear().poles()) for own in (before, after)]
    return counts[1] > counts[0]


def rings_on(before: Comparison, after: Comparison) -> bool:
    """Whether a step brings a mode that outlasts a record: then its transient, free as it is, stands in for a tone.

    A linear mode: what a nonlinear effect does at rest is not what it does in motion.
    """
    models = [own.model.without_nonlinear() for own in (after, before)]
    for part in before.noise.in_time:
        lasts = part.record.samples / part.record.sample_rate
        new, known = (model.at(part.record).poles() for model in models)
        if _lasting(new, RINGS_ON / lasts) > _lasting(known, 2.0 * RINGS_ON / lasts):
            return True
    return False


def _lasting(poles: ComplexArray, rate: float) -> int:
    """Modes that decay more slowly than that [1/s]."""
    return int(np.sum((poles.imag > 0.0) & (-poles.real < rate)))


def _rises(task: Task, state: State, better: Comparison) -> bool:
    """Whether a step makes records that were kept back worse, by more than chance and what is left there allow."""
    if not task.validate or state.validation is None:
        return False
    degrees = max(1, len(better.model.names) - len(state.fit.model.names))
    try:
        after = state.validation.of(better.model).with_own_angles()
        rise = after.cost - state.validation.cost
    except UnstableLoopError:
        return True  # no such record was made by a loop that leaves all bounds
    return rise > chdtri(degrees, ALPHA) * max(1.0, after.misfit)


def _is_negligible(state: State, ranking: Ranking) -> bool:
    """Whether what is called for may be the error of a formula that the model holds already.

    Beside an effect that explains a hundred times as much, only what explains most of the rest counts; nor does what a
    formula is known to leave, see `Effect.formula_error`.
    """
    best = max((candidate.score for candidate in ranking.significant), default=0.0)
    small = best < NEGLIGIBLE_SHARE * state.fall
    minor = state.fit.cost < state.at_noise or best < 0.5 * (state.fit.cost - state.dof)
    return bool(state.added) and (small and minor or best < state.of_formulas)


def _to_the_noise(task: Task, state: State) -> Iterator[State]:
    """Steps that explain little each, if together they lead to the noise; not beside a law that is idealised.

    The formula of a linear effect leaves less than that, or what is left has no name. Where the misfit is within its
    bound, other evidence has to show each of them: a small lag beside a large delay bends tau_e by a hundred of its
    standard errors, at a misfit of 1.05.
    """
    if state.physics and state.fit.model.is_linear:
        steps = list(_added(task, state, None, however_small=True))
        if steps and steps[-1].fit.cost < state.at_noise:
            yield from steps


def _worth_refitting(state: State, ranking: Ranking) -> list[Candidate]:
    """The significant candidates whose score is at least half of the best, since scores can err by that much.

    Where far more than noise is left, they must promise to explain a tenth of it.
    """
    significant = ranking.significant
    least = 0.5 * max((candidate.score for candidate in significant), default=0.0)
    if state.fit.cost > state.at_noise:
        least = max(least, PROMISING_SHARE * (state.fit.cost - state.dof))
    return [candidate for candidate in significant if candidate.score >= least][:REFITTED]


def _taken(task: Task, state: State, better: Comparison, added: Effect) -> State:
    """Go on from a better model; what one far off leaves between the excited lines is no noise, and hides tones."""
    better = refit(better)
    for effect in better.model.effects[len(state.base.model.effects) :]:
        if effect not in task.as_given:
            better = settled(better, effect)  # beside what was added since, a place is another
    better = _nearer_the_rig(task, better, added)
    (added,) = (effect for effect in better.model.effects if effect.name == added.name)
    fall, reference = state.fit.cost - better.cost, state.reference
    if added.frequencies_hz(better.model.rig):
        own = {p.name.split(".", 1)[1]: p.value for p in better.model.parameters if p.name.startswith(f"{added.name}.")}
        reference = refit(reference.of(reference.model.add(added, own)))
    state = replace(state, fit=better, reference=reference)
    if fall <= state.dof and not better.noise.misses_tone(better.model):
        return state
    fit = better
    for _ in range(MOST_RENEWALS):
        before = fit.cost
        fit = refit(fit.renewed())
        if abs(fit.cost - before) <= RENEWED * before:
            break
    return replace(state, fit=fit, base=fit.of(state.base.model), reference=fit.of(reference.model))


def _nearer_the_rig(task: Task, fit: Comparison, added: Effect) -> Comparison:
    """Of two lags in series, which may be exchanged, the one of the base model nearer to that of the rig file."""
    values = dict(zip(fit.model.names, fit.model.theta.tolist(), strict=True))
    nominal = dict(zip(task.nominal.names, task.nominal.theta.tolist(), strict=True))
    for name, other in added.in_series.items():
        own = added.slot(name)
        if own in values and values.get(other, 0.0) > 0.0 and nominal.get(other, 0.0) > 0.0:
            now, exchanged = (abs(np.log(values[key] / nominal[other])) for key in (other, own))
            if exchanged < now:
                swapped = refit(fit.of(fit.model.with_values({own: values[other], other: values[own]})))
                fit = min(fit, swapped, key=lambda each: each.cost - EQUALLY_GOOD * (each is swapped))
    return fit


def _ranked(task: Task, state: State) -> Ranking:
    """From the fit, or, where misfit has driven its parameters off, from where the diagnosis began."""
    start = nominal_with_effects_of(task, state.fit.model)
    is_lost = state.fit.cost > LOST * state.dof and is_driven_off(task, state.fit.model) and start.is_stable
    return rank(state.fit.of(start) if is_lost else state.fit, task.catalogue, start=start, progress=task.progress)


def _at_limits(fit: Comparison) -> set[str]:
    return {p.name for p in fit.model.parameters if p.is_at_limit}


def _pruned(task: Task, state: State) -> Iterator[State]:
    """Take out effects that a later one has made needless; not where it stands in for a tone, or at a bound."""
    for effect in state.added[:-1]:
        try:
            less = refit(state.fit.of(state.fit.model.without(effect.name)), step=ROUGHLY)
        except UnstableLoopError:
            continue  # no loop without it
        degrees = len(state.fit.model.names) - len(less.model.names)
        stands_in = rings_on(state.fit, less) or bool(_at_limits(less) - _at_limits(state.fit))
        if less.cost - state.fit.cost < chdtri(degrees, ALPHA) and not stands_in:
            state = replace(state, fit=refit(less), sets=state.without_set(effect.name))
            state = noted(task, state, _ranked(task, state), removed=effect.name)
            yield state
