"""The sets that are tried: proposed by scores, carried on where they may still win.

No first step need explain anything: the set must. From each of the best sets the candidates whose scores promise most
are added and refitted; a set is carried on as long as a further effect could make it as likely as the best. The best
set is then tried with each of its effects taken out, and replaced.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import chain, zip_longest
from typing import Any

import numpy as np

from ambid.diagnosis.candidates import Candidate, Ranking
from ambid.diagnosis.evidence import price_of
from ambid.diagnosis.hypotheses import Field, Hypothesis, Names
from ambid.diagnosis.nameless import Ways
from ambid.diagnosis.refits import added, beside_shapes, home, ranked, refined, without
from ambid.diagnosis.task import Task
from ambid.effects import CATALOGUE, Effect, Trait
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.problem import UNDERSTATED
from ambid.model import Model

WIDTHS = (8, 4, 3, 2)
"""Candidates that are refitted beside the base model, beside a set of one, of two, and of more."""
CARRIED = 3
"""Sets of one size that are carried on."""
MOST_EFFECTS = 4
"""Effects of a set, at the most: by `evidence.USUAL`, one machine in 60 000 has more."""
BEHIND = 3.0
"""Log evidence by which a set may fall behind the best, by its score, and still be refitted."""
Ask = Callable[[Ranking, Candidate], bool | Candidate]
"""Shown a ranking and the candidate that is to be added; False ends the search, another candidate is added instead."""


def explored(task: Task, field_: Field) -> Iterator[Field]:
    """Try sets of effects, those first that the scores promise most of."""
    if field_.root:
        yield (field_ := refined(task, field_, field_.foremost.names))
    for size in range(len(field_.root), MOST_EFFECTS):
        if size > len(field_.root) and not _leads_on(field_, size):
            break
        sets = sorted(
            (h for h in field_.tried.values() if len(h.names) == size),
            key=lambda h: field_.promise(h.evidence),
            reverse=True,
        )
        before = field_.foremost
        for one in sets[:CARRIED]:
            if field_.is_explained and field_.promise(one.evidence) < field_.promise(field_.foremost.evidence) - BEHIND:
                break  # what it leaves, another set has explained
            for further in _carried_on(task, field_, one.names):
                yield (field_ := further)
        for further in _in_pairs(task, field_) if size == len(field_.root) else ():
            yield (field_ := further)
        if field_.foremost is not before:
            yield (field_ := refined(task, field_, field_.foremost.names))
    for further in reconsidered(task, field_):
        yield (field_ := further)
    for further in _held_against_shapes(task, field_):
        yield (field_ := further)


def _held_against_shapes(task: Task, field_: Field) -> Iterator[Field]:
    """What has a shape but no name, in the place of effects of the best set; what is explained so needs no more."""
    best = field_.foremost
    for names in sorted((own for own in field_.tried if own < best.names), key=len):
        if any(own <= names and not beside.evidence.beyond for own, beside in field_.nameless.items()):
            continue
        task.progress(f"a smooth shape in the place of {' + '.join(sorted(best.names - names))}", 0, 1)
        yield (field_ := beside_shapes(task, field_, names))


def _leads_on(field_: Field, size: int) -> bool:
    """Whether more effects than so many may explain: the last one explained its share of what was left.

    Of n effects that are missing, the largest explains no less than 1/n.
    """
    best = field_.foremost
    if len(best.names) < size or field_.is_explained:
        return len(best.names) >= size
    before = min((h.evidence.beyond for h in field_.tried.values() if len(h.names) == size - 1), default=np.inf)
    return best.evidence.beyond <= before * (1.0 - 1.0 / (MOST_EFFECTS - size + 1))


def asked(task: Task, field_: Field, ask: Ask) -> Iterator[Field]:
    """Add what is most likely beside the set so far, as long as a person agrees."""
    names = field_.foremost.names
    while len(names) < MOST_EFFECTS:
        for further in _carried_on(task, field_, names):
            yield (field_ := further)
        beside = [h for h in field_.tried.values() if names < h.names and len(h.names) == len(names) + 1]
        best = max(beside, key=lambda h: field_.promise(h.evidence), default=None)
        if best is None or field_.promise(best.evidence) <= field_.promise(field_.tried[names].evidence):
            return
        ranking = field_.rankings[names]
        (proposed,) = (c for c in ranking.candidates if c.effect.name in best.names - names)
        answer = ask(ranking, proposed)
        if not answer:
            yield _of_the_way(field_, names)
            return
        candidate = answer if isinstance(answer, Candidate) else proposed
        field_ = added(task, field_, names, candidate)
        names = names | {candidate.effect.name}
        if candidate is not proposed:
            field_ = _of_the_way(field_, names)
        yield (field_ := refined(task, field_, names))


def _of_the_way(field_: Field, names: Names) -> Field:
    """The field with the sets alone that lie on the way to one that a person has chosen against what was proposed."""
    return replace(field_, tried={own: h for own, h in field_.tried.items() if own <= names})


def _carried_on(task: Task, field_: Field, names: Names, *, by_scores: bool = False) -> Iterator[Field]:
    """The best candidates beside a set, as far as one of them may still make it as likely as the best.

    So may those of which scores say nothing, unless it is to go by scores.
    """
    field_ = _ranked(task, field_, names)
    if names not in field_.rankings:
        return
    hypothesis = field_.tried[names]
    most = WIDTHS[min(len(names), len(WIDTHS) - 1)]
    order = _by_promise(task, field_, hypothesis, field_.rankings[names])
    if by_scores:
        order = [c for c in order[:most] if not _is_blind(hypothesis, c)]
    else:
        order = order[:most] + [c for c in order[most:] if _is_blind(hypothesis, c)]
    for done, candidate in enumerate(order):
        so_far = f"{len(field_.tried)} sets tried, misfit {field_.foremost.fit.misfit:.3g}"
        task.progress(f"refitting {candidate.effect.name} ({so_far})", done, len(order))
        if names | {candidate.effect.name} not in field_.tried and may_win(task, field_, hypothesis, candidate):
            with suppress(ModelError):
                yield (field_ := added(task, field_, names, candidate))
    yield field_


def _ranked(task: Task, field_: Field, names: Names) -> Field:
    """The field with what is outside a set, ranked; as it is where that is stable where it was fitted alone."""
    if names in field_.rankings:
        return field_
    with suppress(UnstableLoopError):
        fit = field_.tried[names].fit
        if names == field_.root:
            known = {effect.name: effect for effect in (*CATALOGUE, *task.catalogue)}
            whole = ranked(replace(task, catalogue=tuple(known.values())), fit)
            field_, own = replace(field_, whole=whole), whole.among({effect.name for effect in task.catalogue})
        else:
            own = replace(ranked(task, fit), ways=Ways())  # something else acts in those of the root
        return replace(field_, rankings={**field_.rankings, names: own})
    return field_


def _in_pairs(task: Task, field_: Field) -> Iterator[Field]:
    """Two candidates beside the base model at once: each may explain nothing alone, or another effect both of them."""
    found = list[tuple[float, Candidate, Candidate]]()
    for one, other, score in field_.rankings[field_.root].joint_scores() if field_.root in field_.rankings else ():
        names = field_.root | {one.effect.name, other.effect.name}
        if not (field_.is_explained and field_.foremost.names <= names):
            first, second = (one, other) if one.score > other.score else (other, one)
            found.append((0.5 * score - _price(task, one) - _price(task, other), first, second))
    for _, first, second in sorted(found, key=lambda pair: -pair[0])[:CARRIED]:
        names = field_.root | {first.effect.name}
        is_new = names in field_.tried and names | {second.effect.name} not in field_.tried
        if is_new and may_win(task, field_, field_.tried[names], second):
            with suppress(ModelError):
                yield (field_ := added(task, field_, names, second))


def _by_promise(task: Task, field_: Field, hypothesis: Hypothesis, ranking: Ranking) -> list[Candidate]:
    """The candidates, those first whose scores promise most; of two places where they were judged, in turn."""
    both = [
        sorted(own, key=lambda c: _promised(task, field_, hypothesis, c, c.score), reverse=True)
        for own in (ranking.candidates, ranking.at_fit)
    ]
    first = dict[str, Candidate]()
    for c in chain.from_iterable(zip_longest(*both)):
        if c is not None:
            first.setdefault(c.effect.name, c)
    return list(first.values())


def may_win(task: Task, field_: Field, hypothesis: Hypothesis, c: Candidate) -> bool:
    """Whether a candidate beside a set could make it as likely as the foremost.

    Where a set leaves more than noise a score may err. Where scores say nothing, refits beside smaller sets do; a refit
    beside the set itself, in another noise, says all. Nothing is sought far off to take what formulas may leave.
    """
    room, fall = field_.left_by(hypothesis), field_.fall_beside(hypothesis, c.effect.name)
    if fall is None:
        is_known = field_.is_of_formulas(hypothesis) or not _is_blind(hypothesis, c)
        felt = c.score if is_known else _felt_before(field_, hypothesis, c)
        fall = max(c.score, room if felt is None else min(room, UNDERSTATED * max(felt, c.score)))
    return _promised(task, field_, hypothesis, c, fall) > field_.promise(field_.foremost.evidence) - BEHIND


def _felt_before(field_: Field, hypothesis: Hypothesis, c: Candidate) -> float | None:
    """Fall of J by a candidate beside smaller sets that have all in common with it that the set has."""
    model = hypothesis.fit.model
    own = traits_of(c.effect, model).keys()
    likes = frozenset(e.name for e in hypothesis.added if own & traits_of(e, model).keys())
    return field_.felt_before(hypothesis, c.effect.name, likes)


def _is_blind(hypothesis: Hypothesis, c: Candidate) -> bool:
    """Whether a score, which is of a small step, says nothing: of what is sought far off, or may not step that way."""
    return (c.one_sided > 0 and c.score <= 0.0) or bool(c.effect.far_starts(home(hypothesis.fit.model, c.effect)))


def _promised(task: Task, field_: Field, hypothesis: Hypothesis, c: Candidate, fall: float) -> float:
    """What a set leaves may have driven how its states begin: beside more they cost what they do in the foremost."""
    own, best = hypothesis.evidence, field_.foremost
    begins = min(own.beginnings, best.evidence.beginnings) if hypothesis.names < best.names else own.beginnings
    return field_.promise(replace(own, cost=own.cost - fall, prior=own.prior + _price(task, c), beginnings=begins))


def _price(task: Task, c: Candidate) -> float:
    return price_of(c.score, c.degrees, c.one_sided, task.price(c.effect) + float(np.log(c.variants)))


def reconsidered(task: Task, field_: Field) -> Iterator[Field]:
    """The best set with more, with each of its effects taken out, and another in its place, until it is the best.

    Where it does not explain, it is tried with more as long as more may explain, and another is in its place where
    scores call for it: all else was tried on the way to it.
    """
    best = None
    while best is None or field_.foremost.names != best:
        best = field_.foremost.names
        may_lead_on = len(best) < MOST_EFFECTS and _leads_on(field_, len(best))
        for further in _carried_on(task, field_, best) if may_lead_on and best not in field_.rankings else ():
            yield (field_ := further)  # it had fallen behind, and lies ahead by what was tried since
        for effect in field_.tried[best].added if len(best) > 1 else ():  # else what is beside the base was tried
            names = best - {effect.name}
            field_ = without(task, field_, field_.tried[best], effect)  # its settings may differ from those tried alone
            if names in field_.tried:
                for further in _carried_on(task, field_, names, by_scores=not field_.is_explained):
                    yield (field_ := further)
        for further in _with_twins(task, field_, best):
            yield (field_ := further)


def _with_twins(task: Task, field_: Field, names: Names) -> Iterator[Field]:
    """What acts as an effect of a set does, in its place, if it may win; what shares a trait, if it explains half.

    Where that effect was moved along the shaft, or to another frequency, so is what takes its place.
    """
    best = field_.tried[names]
    for effect in best.added:
        rest = names - {effect.name}
        if rest not in field_.rankings or rest not in field_.tried:
            continue
        before, candidates = field_.tried[rest], field_.rankings[rest].candidates
        mine = traits_of(effect, best.fit.model).keys()
        # of what the effect explains, or of what its own score says of that, which may be understated by more
        own = [c.score for c in candidates if c.effect.name == effect.name and not _is_blind(before, c)]
        half = 0.5 * min([field_.left_by(before) / UNDERSTATED, *own])
        for c in candidates:
            there = _where_it_is(c, effect)
            if c.effect.name in names or (there is c and rest | {c.effect.name} in field_.tried):
                continue
            is_twin = bool(mine & traits_of(c.effect, before.fit.model).keys())
            explains = is_twin and c.score > half
            acts_alike = is_twin or effect.name in c.confusable_with
            if explains or (acts_alike and may_win(task, field_, before, c)):
                with suppress(ModelError):
                    yield (field_ := added(task, field_, rest, there))


def _where_it_is(candidate: Candidate, effect: Effect) -> Candidate:
    """A candidate at the settings of an effect that it has too, such as a place; itself where it was judged there."""
    mine: Any = candidate.effect
    settings = {name: getattr(effect, name) for name in mine.fine if name in effect.fine}
    moved = {name: here for name, here in settings.items() if here is not None and here != getattr(mine, name)}
    return replace(candidate, effect=replace(mine, **moved), near=()) if moved else candidate


def traits_of(effect: Effect, model: Model) -> Mapping[Trait, float]:
    """Traits of an effect at its values in a model, typical ones where it is not there."""
    rig, prefix = home(model, effect), f"{effect.name}."
    own = {p.name.removeprefix(prefix): p.value for p in model.parameters if p.name.startswith(prefix)}
    return effect.traits(rig, {p.name: p.probe for p in effect.parameters(rig)} | own)
