"""Refits: an effect beside a set, a set at its best settings in the noise that it leaves, what is outside of it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from ambid.arrays import FloatArray
from ambid.diagnosis.candidates import ALPHA, Candidate, Ranking
from ambid.diagnosis.evidence import OF_FORMULAS, Yardstick
from ambid.diagnosis.hypotheses import FAR_BEHIND, Field, Hypothesis, Names
from ambid.diagnosis.ranking import rank
from ambid.diagnosis.settled import placed, settled
from ambid.diagnosis.task import Task
from ambid.effects import Effect
from ambid.effects.places import AtPlace
from ambid.effects.shapes import SHAPES
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import refit
from ambid.identification.problem import CLOSELY, ROUGHLY, UNDERSTATED
from ambid.identification.renewal import MOST_RENEWALS, around_edge, hardly, stays
from ambid.model import Model
from ambid.noise import Comparison, Noise
from ambid.rig import Rig

LOST = 2.0
"""Misfit J/dof above which parameters that have left their start say little."""
LIKE = 0.99
"""Part of a variant's score that another must have for both to be refitted; of a base model that is far off, none."""
FAR_OFF = 20.0
"""Misfit J/dof above which refits start from the rig file's values too."""
EQUALLY_GOOD = 1.0
"""Difference of J of two lags that are exchanged, which leave the same."""
HOPELESS = 1e3
"""Log evidence by which no other noise lets a set catch up; one that is hardly another does not by `FAR_BEHIND`."""
Start = tuple[Model, Effect, Mapping[str, float]]


def added(task: Task, field_: Field, names: Names, candidate: Candidate) -> Field:
    """The field with a candidate beside a set.

    Raises
    ------
    ModelError
        If no stable loop with it is found.
    """
    before = field_.tried[names]
    further, bar = field_, field_.bar(before, candidate.effect)
    is_explained = field_.is_explained and field_.left_by(before) > 0.0  # what this set leaves, by another
    for end in _refitted(task, before, candidate, bar, is_explained=is_explained):
        fit = _at_their_places(task, end)
        explains, leaves = before.fit.cost - fit.cost, fit.cost - fit.dof
        is_priced = fit.cost < bar + 2.0 * HOPELESS  # else nothing brings it back
        is_settled = candidate.effect in task.as_given or not is_priced
        if explains > leaves > (fit.by_chance - 1.0) * fit.dof and not is_settled:
            (effect,) = (own for own in fit.model.effects if own.name == candidate.effect.name)
            fit = settled(fit, effect)  # where it is makes a difference
        variants = before.variants * candidate.variants
        with suppress(UnstableLoopError):  # it stands at the edge of stability
            further = further.with_(task.beside_nominal(fit.model), fit, variants, is_priced=is_priced)
    if names | {candidate.effect.name} in further.tried:
        return further.felt(names, candidate.effect.name)
    raise ModelError(f"{candidate.effect.name}: no stable loop with it was found; leave it out, or choose another")


def _refitted(
    task: Task, before: Hypothesis, candidate: Candidate, bar: float, *, is_explained: bool
) -> list[Comparison]:
    """A candidate beside a set, from its predicted values; where the set is far off, from the rig file's too.

    Where another set explains what this one leaves, what competes with it is found from where this set is, far off as
    that may be. Of variants with as many parameters each the best, those with fewer too: by J alone, that with most
    always is. What one start of a variant explains within chance, or what formulas leave, needs no other start, but one
    far off where it explains nothing, and other variants that a score does not tell from it: a few in J decide between
    sets. None is followed that promises to stay above a bar.
    """
    fit = before.fit
    is_far_off = fit.cost > FAR_OFF * fit.dof and not is_explained
    starts: list[Start] = [(fit.model, candidate.effect, candidate.start)]
    starts += [
        (fit.model, effect, values)
        for effect, values, share in candidate.near
        if is_far_off or share > LIKE or _numbers(fit, effect) < _numbers(fit, candidate.effect)
    ]
    if candidate.from_start or is_far_off or (_is_driven_off(task, fit.model) and not is_explained):
        starts.append((nominal_beside(task, fit.model), candidate.effect, candidate.start))
    far = _nearest(task, fit, [candidate.effect, *(effect for effect, _, _ in candidate.near)])
    starts += [*far, (fit.model, candidate.effect, {})]
    enough = fit.dof + max(fit.dof * (fit.by_chance - 1.0), OF_FORMULAS * (fit.cost - fit.dof))
    alike = [effect for effect, _, share in candidate.near if share > LIKE]
    found, least = 0, dict[int, Comparison]()  # by the number of parameters
    for start in starts:
        base, effect, values = start
        count = _numbers(fit, effect)
        reached = least[count].cost if count in least else np.inf
        is_untried = effect in alike or (start in far and fit.cost - reached < chdtri(count, ALPHA))
        if (reached < enough and not is_untried) or found == len(starts) - 1:
            continue
        if effect in alike:
            alike.remove(effect)
        with suppress(UnstableLoopError, ModelError, ValueError):
            end = refit(fit.of(base.add(effect, values)), step=ROUGHLY, bound=min(bar, reached))
            if end.cost > enough:
                end = around_edge(end, min(bar, reached))
            found += 1
            least[count] = end if end.cost < reached else least[count]
    return sorted(least.values(), key=lambda end: end.cost)


def _at_their_places(task: Task, fit: Comparison, also: Sequence[float | None] = ()) -> Comparison:
    """A fit with each effect that may act elsewhere where it explains most: at places of its own, or of the others."""
    for name in [effect.name for effect in fit.model.effects if effect not in task.as_given]:
        (effect,) = (own for own in fit.model.effects if own.name == name)
        if isinstance(effect, AtPlace):
            others = [own.z for own in fit.model.effects if isinstance(own, AtPlace) and own.name != name]
            fit = placed(fit, effect, [*effect.places(home(fit.model, effect)), *others, *also])
    return fit


def _numbers(fit: Comparison, effect: Effect) -> int:
    """How many parameters an effect has beside a model."""
    return len(effect.parameters(home(fit.model, effect)))


def _nearest(task: Task, fit: Comparison, effects: Sequence[Effect]) -> list[Start]:
    """Of the far starts of some effects the one that comes nearest to the records, from the fit or the rig file."""
    far = [(effect, values) for effect in effects for values in effect.far_starts(home(fit.model, effect))]
    found: list[tuple[float, Start]] = []
    for base in (fit.model, nominal_beside(task, fit.model)) if far else ():
        with suppress(UnstableLoopError):
            linear, more = _linear_part(fit.noise, base)
            for effect, values in far:
                with suppress(UnstableLoopError, ModelError):
                    # without transients, at a part of the time
                    left = fit.noise.departure(linear.add(effect, values)) + more
                    found.append((float(left @ left), (base, effect, dict(values))))
    return [min(found, key=lambda own: own[0])[1]] if found else []


def _linear_part(noise: Noise, base: Model) -> tuple[Model, FloatArray]:
    """A model without its nonlinear effects, and what these change of its response; all of it if it stands by them."""
    linear = base.without_nonlinear()
    if base.is_linear or not linear.is_stable:
        return base, np.zeros(1)
    return linear, noise.departure(base) - noise.departure(linear)


def ranked(task: Task, fit: Comparison) -> Ranking:
    """What is outside a set, from the fit; where misfit has driven it off, from where the diagnosis began too."""
    start = nominal_beside(task, fit.model)
    own = rank(fit, task.catalogue, start=start, progress=task.progress)
    if fit.cost <= LOST * fit.dof or not _is_driven_off(task, fit.model) or not start.may_stand:
        return own
    begun = rank(fit.of(start), task.catalogue, start=start, progress=task.progress)
    return replace(begun, at_fit=own.candidates)


def beside_shapes(task: Task, field_: Field, names: Names) -> Field:
    """The field with what has a shape but no name beside a set, where it explains half of what is left by its score."""
    before = field_.tried[names]
    with suppress(UnstableLoopError):
        for candidate in rank(before.fit, SHAPES, start=nominal_beside(task, before.fit.model)).candidates:
            if candidate.score > 0.5 * field_.left_by(before) / UNDERSTATED:
                with suppress(ModelError):
                    own = added(task, field_, names, candidate).tried[names | {candidate.effect.name}]
                    known = field_.nameless.get(names)
                    if known is None or known.evidence.alone < own.evidence.alone:
                        field_ = replace(field_, nameless={**field_.nameless, names: own})
    return field_


def refined(task: Task, field_: Field, names: Names) -> Field:
    """A set at its best settings, and all sets in the noise that it leaves.

    What a model far off leaves between the excited lines is no noise, and hides tones.
    """
    best = field_.tried[names]
    fit = best.fit
    for effect in best.added:
        if effect not in task.as_given:
            fit = settled(fit, effect)
        fit = _nearer_the_rig(task, fit, effect)
    effects = task.beside_nominal(fit.model)
    is_near = not field_.root and field_.base.fit.cost - fit.cost <= fit.dof and not fit.noise.misses_tone(fit.model)
    begun = fit.renewed()
    if is_near and stays(begun):
        return field_.with_(effects, refit(fit, step=CLOSELY), best.variants)
    for _ in range(MOST_RENEWALS):
        fit = refit(begun, step=CLOSELY)
        if begun.cost - fit.cost < hardly(begun):
            break
        begun = fit.renewed()
    base = refit(fit.of(field_.base.fit.model), step=ROUGHLY)
    kept_back = field_.yardstick.kept_back
    if kept_back is not None:
        kept_back = kept_back.of(fit.model).renewed().of(base.model)
    renewed = replace(field_, yardstick=Yardstick(base, kept_back, task.prior), tried={}, nameless={})
    renewed = renewed.with_(field_.base.added, base).with_(effects, fit, best.variants)
    for own in field_.tried.values():
        is_rival = len(own.names) >= len(best.names) > 0 and not _is_hopeless(field_, own, best)
        if (own.names < best.names or is_rival) and own.names not in renewed.tried:
            with suppress(UnstableLoopError):
                renewed = renewed.with_(own.added, refit(fit.of(own.fit.model), step=ROUGHLY), own.variants)
    return renewed


def _is_hopeless(field_: Field, own: Hypothesis, best: Hypothesis) -> bool:
    """Whether no other noise makes a set as likely as the best; where that explains, noise is hardly another."""
    behind = field_.promise(best.evidence) - field_.promise(own.evidence)
    return behind > (FAR_BEHIND if field_.is_explained else HOPELESS)


def ended(field_: Field, names: Names) -> Field:
    """The field with a set at its optimum to the last digit, which the search comes near.

    Sets that have another effect in the place of one of its, from the values that both have in common: rough descents
    may end apart, and what distinguishes two sets may be less than that.
    """
    own = field_.tried[names]
    if not own.added:
        return field_
    fit = refit(own.fit)
    field_ = field_.with_(own.added, fit, own.variants)
    for other in list(field_.tried.values()):
        is_like = len(other.names) == len(names) == len(names | other.names) - 1 and len(names) > 1
        if is_like and not _is_hopeless(field_, other, own):
            with suppress(UnstableLoopError):
                start = _at_values_of(fit.model, other.fit.model)
                end = refit(fit.of(start), step=ROUGHLY, bound=other.fit.cost)
                field_ = field_.with_(other.added, end, other.variants)
    return field_


def _nearer_the_rig(task: Task, fit: Comparison, effect: Effect) -> Comparison:
    """Of two lags in series, which may be exchanged, the one of the base model nearer to that of the rig file."""
    values = {p.name: p.value for p in fit.model.parameters}
    start = {p.name: p.value for p in task.nominal.parameters if p.value > 0.0}
    for name, other in effect.in_series.items():
        own = effect.slot(name)
        if own in values and other in start and values.get(other, 0.0) > 0.0:
            now, exchanged = (abs(np.log(values[key] / start[other])) for key in (other, own))
            if exchanged < now:
                swapped = refit(fit.of(fit.model.with_values({own: values[other], other: values[own]})), step=ROUGHLY)
                fit = swapped if swapped.cost < fit.cost + EQUALLY_GOOD else fit
    return fit


def without(task: Task, field_: Field, hypothesis: Hypothesis, effect: Effect) -> Field:
    """The field with a set less one of its effects: from the values beside it, and from those that were without it.

    Another effect may take its place.
    """
    model = hypothesis.fit.model.without(effect.name)
    starts, known = [model], field_.tried.get(hypothesis.names - {effect.name})
    reached = np.inf if known is None else known.fit.cost
    if known is not None:
        starts.append(_at_values_of(known.fit.model, model))
    for start in starts:
        with suppress(UnstableLoopError):  # no loop without it
            fit = refit(hypothesis.fit.of(start), step=ROUGHLY, bound=reached)
            fit = _at_their_places(task, fit, [effect.z] if isinstance(effect, AtPlace) else [])
            field_ = field_.with_(task.beside_nominal(fit.model), fit, hypothesis.variants)
            reached = min(reached, fit.cost)
    return field_


def nominal_beside(task: Task, model: Model) -> Model:
    """The nominal values of the base parameters, the present ones of the effects."""
    return _at_values_of(task.nominal, model)


def _at_values_of(other: Model, model: Model) -> Model:
    """A model at the values of another, as far as that has them."""
    return model.with_values({p.name: p.value for p in other.parameters if p.name in model.names})


def _is_driven_off(task: Task, model: Model) -> bool:
    """Whether a parameter of the base model has left its start by more than a factor of two."""
    now = {p.name: p.value for p in model.parameters}
    start = {p.name: p.value for p in task.nominal.parameters if p.name in now and p.value > 0.0}
    return any(not 0.5 < now[name] / value < 2.0 for name, value in start.items())


def home(model: Model, effect: Effect) -> Rig:
    """The rig that an effect of a model changes."""
    return model.home_of(effect) or model.rig
