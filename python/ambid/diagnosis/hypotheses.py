"""Sets of effects beside the base model, each refitted: proposed by scores, carried on where they may still win.

No first step need explain anything: the set must. From each of the best sets the candidates whose scores promise most
are added and refitted; a set is carried on as long as a further effect could make it as likely as the best. The best
set is then tried with each of its effects taken out, and replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ambid.diagnosis.candidates import Candidate, Ranking
from ambid.diagnosis.evidence import OF_FORMULAS, Evidence, Yardstick, price_of
from ambid.diagnosis.ranking import rank
from ambid.diagnosis.settled import settled
from ambid.diagnosis.task import Task
from ambid.effects import Effect, Trait
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import ROUGHLY, refit
from ambid.model import Model
from ambid.noise import Comparison, compare
from ambid.rig import Rig

__all__ = [
    "Ask",
    "Field",
    "Hypothesis",
    "added",
    "asked",
    "begun",
    "explored",
    "nominal_beside",
    "ranked",
    "refined",
    "traits_of",
    "without",
]

WIDTHS = (8, 4, 3, 2)
"""Candidates that are refitted beside the base model, beside a set of one, of two, and of more."""
CARRIED = 3
"""Sets of one size that are carried on."""
MOST_EFFECTS = 5
"""Effects of a set, at the most."""
BEHIND = 3.0
"""Log evidence by which a set may fall behind the best, by its score, and still be refitted."""
ERR = 4.0
"""Factor by which a score may err: it is the fall of J along a straight line."""
LOST = 2.0
"""Misfit J/dof above which parameters that have left their start say nothing."""
LIKE = 0.99
"""Part of a variant's score that another must have for both to be refitted; of a base model that is far off, none."""
FAR_OFF = 20.0
"""Misfit J/dof above which refits start from the rig file's values too."""
EQUALLY_GOOD = 1.0
"""Difference of J of two lags that are exchanged, which leave the same."""
MOST_RENEWALS = 3
"""So often is the noise renewed after the best set has changed, at the most."""
RENEWED = 0.02
"""Relative change of J by renewing the noise that is small enough."""

Names = frozenset[str]
Start = tuple[Model, Effect, Mapping[str, float]]
Ask = Callable[[Ranking, Candidate], bool | Candidate]
"""Shown a ranking and the candidate that is to be added; False ends the search, another candidate is added instead."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects beside the base model.

    Attributes
    ----------
    added : tuple of Effect
        In the order of their adding.
    fit : Comparison
        Refitted.
    kept_back : Comparison or None
        The same model with the records to validate on.
    variants : float
        So many independent variants of the effects were looked at, such as places: these are the best.
    evidence : Evidence
    """

    added: tuple[Effect, ...]
    fit: Comparison
    kept_back: Comparison | None
    variants: float
    evidence: Evidence

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order of their adding."""
        return tuple(effect.name for effect in self.added)

    @property
    def validation_misfit(self) -> float | None:
        """J/dof of the records to validate on, to which nothing was fitted; None without such."""
        own = self.kept_back
        return None if own is None else own.cost / (own.dof + len(own.model.free))

    @property
    def names(self) -> Names:
        """Of the effects."""
        return frozenset(effect.name for effect in self.added)


@dataclass(frozen=True)
class Field:
    """All sets that were tried, in one noise.

    Attributes
    ----------
    yardstick : Yardstick
    tried : mapping of frozenset of str to Hypothesis
        By the names of the effects.
    rankings : mapping of frozenset of str to Ranking
        Of what is outside each set that was carried on.
    root : frozenset of str
        What makes an unstable base model stable, in the set that the search began with; nothing of a stable one.
    """

    yardstick: Yardstick
    tried: Mapping[Names, Hypothesis] = field(default_factory=dict)
    rankings: Mapping[Names, Ranking] = field(default_factory=dict)
    root: Names = frozenset()

    @property
    def base(self) -> Hypothesis:
        """The base model alone; where that is unstable, with what makes it stable, the set that it began with."""
        return self.tried[self.root]

    @property
    def unexplained(self) -> Evidence:
        """Of the base model alone; of an unstable one, that of a machine that does not move."""
        return self.yardstick.motion(self.base.evidence) if self.root else self.base.evidence

    @cached_property
    def _lowest(self) -> Evidence:
        """Of the set that comes nearest to noise."""
        return max((h.evidence for h in self.tried.values()), key=lambda own: own.alone)

    def alone(self, own: Evidence) -> float:
        """Log evidence of a set where nothing else is missing, up to what all have in common."""
        return -0.5 * self._above(own) - own.price() - self._lowest.against

    def beside(self, own: Evidence) -> float:
        """The same beside something else that has no name."""
        return own.beside(self._left(own), self._lowest)

    def left_by(self, hypothesis: Hypothesis) -> float:
        """What a set leaves beyond noise, of J."""
        return self._left(hypothesis.evidence)

    def _left(self, own: Evidence) -> float:
        return self._lowest.beyond + max(0.0, self._above(own))

    def _above(self, own: Evidence) -> float:
        """J of a set above that of the set that comes nearest to noise, but for what its formulas are known to leave.

        That is a hypothesis of its own that is bound to the effect: it gives no other effect a name.
        """
        above = own.cost - self._lowest.cost
        of_formulas = own.formula_error * (self.unexplained.cost - own.cost)
        return above if above < 0.0 else max(0.0, above - max(0.0, of_formulas))

    def worth(self, hypothesis: Hypothesis) -> float:
        """Log evidence of a set, whatever is beside it."""
        return self._worth(hypothesis.evidence)

    def _worth(self, own: Evidence) -> float:
        return float(np.logaddexp(self.alone(own), self.beside(own)))

    def is_of_formulas(self, hypothesis: Hypothesis) -> bool:
        """Whether what a set leaves beyond noise is so little of what it explains that its formulas may leave it.

        Those of a disturbance leave nothing, and it has lines of its own.
        """
        before = self.without_physics(hypothesis)
        share = max(OF_FORMULAS, hypothesis.evidence.formula_error)
        return bool(hypothesis.added) and hypothesis.evidence.fitted_beyond <= share * before.fitted_beyond

    def without_physics(self, hypothesis: Hypothesis) -> Evidence:
        """The disturbances of a set alone, which have lines of their own; the base model where that was not tried."""
        waves = self._waves(hypothesis)
        return self.tried[waves].evidence if waves in self.tried else self.unexplained

    @staticmethod
    def _waves(hypothesis: Hypothesis) -> Names:
        return frozenset(e.name for e in hypothesis.added if e.frequencies_hz(hypothesis.fit.model.rig))

    @cached_property
    def is_explained(self) -> bool:
        """Whether a set leaves no more than noise and what its formulas may leave."""
        return not self._lowest.beyond or any(self.is_of_formulas(h) for h in self.tried.values())

    def fall_by_physics(self, hypothesis: Hypothesis) -> float:
        """By how much the physics of a set lowers J of the fitted records."""
        waves = self._waves(hypothesis)
        before = self.tried.get(waves) or (None if self.root else self.base)
        cost = hypothesis.fit.noise.measured_cost if before is None else before.fit.cost
        return max(0.0, cost - hypothesis.fit.cost)

    def share_of_motion(self, hypothesis: Hypothesis) -> float:
        """Part of what the records hold beyond noise that a set explains, 0 to 1."""
        before, left = self.unexplained.fitted_beyond, hypothesis.evidence.fitted_beyond
        return max(0.0, 1.0 - left / before) if before else 1.0

    def promise(self, own: Evidence) -> float:
        """Log evidence of a set, taking for noise what the set leaves that comes nearest to it: the set must explain.

        While sets are sought, something else explains most, and says nothing of where to go on; not where a set leaves
        what formulas may leave. What is foreseen to come nearer to noise than all has its own odds against noise.
        """
        if self.is_explained:
            foreseen = -0.5 * self._above(own) - own.price() - own.against
            return max(self._worth(own), foreseen) if own.alone > self._lowest.alone else self._worth(own)
        left = max(1.0, self._lowest.cost / self._lowest.expected)
        return -0.5 * own.cost / left - own.price(left)

    @cached_property
    def foremost(self) -> Hypothesis:
        """The set of most promise."""
        return max(self.tried.values(), key=lambda own: self.promise(own.evidence))

    @cached_property
    def best(self) -> Hypothesis:
        """The set with most evidence."""
        return max(self.tried.values(), key=self.worth)

    def with_(self, added: tuple[Effect, ...], fit: Comparison, variants: float = 1.0) -> Field:
        """The field with a further set, or with a better fit of it."""
        other = self.yardstick.kept_back
        kept_back = None if other is None else other.of(fit.model).with_own_angles()
        evidence = self.yardstick.evidence(fit, kept_back, added, variants)
        further = Hypothesis(added, fit, kept_back, variants, evidence)
        known = self.tried.get(further.names)
        if known is not None and known.evidence.alone >= further.evidence.alone:
            return self
        return replace(self, tried={**self.tried, further.names: further})


def begun(task: Task, base: Comparison, *others: Comparison) -> Field:
    """The field with the base model alone; of an unstable one, with each of what makes it stable, the best first."""
    kept_back = compare(base.model, task.validate) if task.validate else None
    added = [fit.model.effects[len(task.nominal.effects) :] for fit in (base, *others)]
    field_ = Field(Yardstick(base, kept_back, task.prior), root=frozenset(effect.name for effect in added[0]))
    for own, fit in zip(added, (base, *others), strict=True):
        field_ = field_.with_(own, fit)
    return field_


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
        if field_.foremost is not before:
            yield (field_ := refined(task, field_, field_.foremost.names))
    for further in _reconsidered(task, field_):
        yield (field_ := further)


def _leads_on(field_: Field, size: int) -> bool:
    """Whether more effects than so many may explain: the last did, and each so far its share of as many as may be."""
    best, base = field_.foremost, field_.unexplained.beyond
    is_due = field_.is_explained or best.evidence.beyond <= base * (1.0 - size / MOST_EFFECTS)
    return len(best.names) >= size and is_due


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


def added(task: Task, field_: Field, names: Names, candidate: Candidate) -> Field:
    """The field with a candidate beside a set.

    Raises
    ------
    ModelError
        If no stable loop with it is found.
    """
    before = field_.tried[names]
    further = field_
    for fit in _refitted(task, before, candidate):
        (effect,) = (own for own in fit.model.effects if own.name == candidate.effect.name)
        with suppress(UnstableLoopError):  # it stands at the edge of stability
            further = further.with_((*before.added, effect), fit, before.variants * candidate.variants)
    if names | {candidate.effect.name} in further.tried:
        return further
    raise ModelError(f"{candidate.effect.name}: no stable loop with it was found; leave it out, or choose another")


def _carried_on(task: Task, field_: Field, names: Names) -> Iterator[Field]:
    """The best candidates beside a set, as far as one of them may still make it as likely as the best."""
    hypothesis = field_.tried[names]
    if names not in field_.rankings:
        try:
            ranking = ranked(task, hypothesis.fit)
        except UnstableLoopError:
            return  # it is stable where it was fitted, and nowhere beside
        field_ = replace(field_, rankings={**field_.rankings, names: ranking})
    most = WIDTHS[min(len(names), len(WIDTHS) - 1)]
    order = _by_promise(task, field_, hypothesis, field_.rankings[names])
    # beside the base model a score may see nothing of what explains all of it: of what is linear, everything is tried
    order = order[:most] + ([] if names != field_.root else [c for c in order[most:] if _is_linear(hypothesis, c)])
    for done, candidate in enumerate(order):
        so_far = f"{len(field_.tried)} sets tried, misfit {field_.foremost.fit.misfit:.3g}"
        task.progress(f"refitting {candidate.effect.name} ({so_far})", done, len(order))
        if names | {candidate.effect.name} not in field_.tried and _may_win(task, field_, hypothesis, candidate):
            with suppress(ModelError):
                yield (field_ := added(task, field_, names, candidate))
    yield field_


def _is_linear(hypothesis: Hypothesis, c: Candidate) -> bool:
    return hypothesis.fit.model.add(c.effect, c.start).is_linear


def _by_promise(task: Task, field_: Field, hypothesis: Hypothesis, ranking: Ranking) -> list[Candidate]:
    """The candidates, those first whose scores promise most."""
    return sorted(ranking.candidates, key=lambda c: _promised(task, field_, hypothesis, c, c.score), reverse=True)


def _may_win(task: Task, field_: Field, hypothesis: Hypothesis, c: Candidate) -> bool:
    """Whether a candidate beside a set could make it as likely as the foremost.

    Where a set leaves more than noise a score may err; beside parameters that misfit has driven off,
    as long as no set explains, by any; so it may where an effect is sought far from where scores are taken.
    """
    room = field_.left_by(hypothesis)
    is_lost = hypothesis.fit.cost > LOST * hypothesis.fit.dof and not field_.is_explained
    is_blind = is_lost or bool(c.effect.far_starts(_home(hypothesis.fit.model, c.effect)))
    promised = _promised(task, field_, hypothesis, c, max(c.score, room if is_blind else min(room, ERR * c.score)))
    return promised > field_.promise(field_.foremost.evidence) - BEHIND


def _promised(task: Task, field_: Field, hypothesis: Hypothesis, c: Candidate, fall: float) -> float:
    own = hypothesis.evidence
    price = price_of(c.score, c.degrees, c.one_sided, task.price(c.effect) + float(np.log(c.variants)))
    return field_.promise(replace(own, cost=own.cost - fall, prior=own.prior + price))


def _home(model: Model, effect: Effect) -> Rig:
    """The rig that an effect of a model changes."""
    return model.home_of(effect) or model.rig


def _refitted(task: Task, before: Hypothesis, candidate: Candidate) -> list[Comparison]:
    """A candidate beside a set, from its predicted values; where the set is far off, from the rig file's too.

    Of variants with as many parameters each the best: by J alone, the one with most parameters always is.
    """
    fit = before.fit
    is_far_off = fit.cost > FAR_OFF * fit.dof
    starts: list[Start] = [(fit.model, candidate.effect, candidate.start)]
    starts += [(fit.model, effect, values) for effect, values, share in candidate.near if is_far_off or share > LIKE]
    if candidate.from_start or is_far_off or _is_driven_off(task, fit.model):
        starts.append((nominal_beside(task, fit.model), candidate.effect, candidate.start))
    if fit.cost > fit.dof * fit.by_chance:
        starts += _nearest(task, fit, [candidate.effect, *(effect for effect, _, _ in candidate.near)])
    starts.append((fit.model, candidate.effect, {}))
    ends: list[Comparison] = []
    for base, effect, values in starts:
        try:
            ends.append(refit(fit.of(base.add(effect, values)), step=ROUGHLY))
        except (UnstableLoopError, ModelError, ValueError):
            continue
        left = ends[-1].cost - fit.dof
        if (
            left < max(fit.dof * (fit.by_chance - 1.0), OF_FORMULAS * (fit.cost - fit.dof))
            or len(ends) == len(starts) - 1
        ):
            break
    least: dict[int, Comparison] = {}
    for end in sorted(ends, key=lambda end: end.cost):
        least.setdefault(len(end.model.names), end)
    return list(least.values())


def _nearest(task: Task, fit: Comparison, effects: Sequence[Effect]) -> list[Start]:
    """Of the far starts of some effects the one that comes nearest to the records, from the fit or the rig file."""
    found: list[tuple[float, Start]] = []
    for effect in effects:
        for values in effect.far_starts(_home(fit.model, effect)):
            for base in (fit.model, nominal_beside(task, fit.model)):
                with suppress(UnstableLoopError, ModelError):
                    found.append((fit.of(base.add(effect, values)).cost, (base, effect, dict(values))))
    return [min(found, key=lambda own: own[0])[1]] if found else []


def ranked(task: Task, fit: Comparison) -> Ranking:
    """What is outside a set, from the fit, or, where misfit has driven it off, from where the diagnosis began."""
    start = nominal_beside(task, fit.model)
    is_lost = fit.cost > LOST * fit.dof and _is_driven_off(task, fit.model) and start.is_stable
    return rank(fit.of(start) if is_lost else fit, task.catalogue, start=start, progress=task.progress)


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
    effects = fit.model.effects[len(task.nominal.effects) :]
    if not field_.root and field_.base.fit.cost - fit.cost <= fit.dof and not fit.noise.misses_tone(fit.model):
        return field_.with_(effects, refit(fit), best.variants)
    for _ in range(MOST_RENEWALS):
        before = fit.cost
        fit = refit(fit.renewed(), step=ROUGHLY)
        if abs(fit.cost - before) <= RENEWED * before:
            break
    fit = refit(fit)
    base = refit(fit.of(field_.base.fit.model), step=ROUGHLY)
    kept_back = field_.yardstick.kept_back
    if kept_back is not None:
        kept_back = kept_back.of(fit.model).renewed().of(base.model)
    renewed = Field(Yardstick(base, kept_back, task.prior), {}, field_.rankings, field_.root)
    renewed = renewed.with_(field_.base.added, base)
    for own in field_.tried.values():
        if own is best:
            renewed = renewed.with_(effects, fit, best.variants)
        elif (
            own.added
            and len(own.added) >= len(effects)
            and field_.promise(own.evidence) > field_.promise(best.evidence) - 1e3
        ):
            try:
                renewed = renewed.with_(own.added, refit(fit.of(own.fit.model), step=ROUGHLY), own.variants)
            except UnstableLoopError:
                continue
    return renewed


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


def _reconsidered(task: Task, field_: Field) -> Iterator[Field]:
    """The best set with each of its effects taken out, and with another in its place, until it is the best of these."""
    best = None
    while best is None or field_.foremost.names != best:
        best = field_.foremost.names
        for effect in field_.tried[best].added if len(best) > 1 else ():  # else what is beside the base was tried
            names = best - {effect.name}
            if names not in field_.tried:
                field_ = without(field_, field_.tried[best], effect)
            if names in field_.tried:
                for further in _carried_on(task, field_, names):
                    yield (field_ := further)
        for further in _with_twins(task, field_, best):
            yield (field_ := further)


def _with_twins(task: Task, field_: Field, names: Names) -> Iterator[Field]:
    """What shares a trait with an effect of a set, in its place; where the rest is far off, if the score allows it."""
    best = field_.tried[names]
    for effect in best.added:
        rest = names - {effect.name}
        mine = traits_of(effect, best.fit.model).keys()
        for c in field_.rankings[rest].candidates if rest in field_.rankings and rest in field_.tried else ():
            model = field_.tried[rest].fit.model
            is_new = c.effect.name not in names and rest | {c.effect.name} not in field_.tried
            is_twin = is_new and mine & traits_of(c.effect, model).keys()
            is_near = field_.tried[rest].fit.misfit < FAR_OFF
            if is_twin and (is_near or _may_win(task, field_, field_.tried[rest], c)):
                with suppress(ModelError):
                    yield (field_ := added(task, field_, rest, c))


def traits_of(effect: Effect, model: Model) -> Mapping[Trait, float]:
    """Traits of an effect at its values in a model, typical ones where it is not there."""
    rig, prefix = _home(model, effect), f"{effect.name}."
    own = {p.name.removeprefix(prefix): p.value for p in model.parameters if p.name.startswith(prefix)}
    return effect.traits(rig, {p.name: p.probe for p in effect.parameters(rig)} | own)


def without(field_: Field, hypothesis: Hypothesis, effect: Effect) -> Field:
    """The field with a set less one of its effects."""
    try:
        fit = refit(hypothesis.fit.of(hypothesis.fit.model.without(effect.name)), step=ROUGHLY)
    except UnstableLoopError:
        return field_  # no loop without it
    return field_.with_(tuple(own for own in hypothesis.added if own is not effect), fit, hypothesis.variants)


def nominal_beside(task: Task, model: Model) -> Model:
    """The nominal values of the base parameters, the present ones of the effects."""
    return model.with_values({p.name: p.value for p in task.nominal.parameters if p.name in model.names})


def _is_driven_off(task: Task, model: Model) -> bool:
    """Whether a parameter of the base model has left its start by more than a factor of two."""
    now = {p.name: p.value for p in model.parameters}
    start = {p.name: p.value for p in task.nominal.parameters if p.name in now and p.value > 0.0}
    return any(not 0.5 < now[name] / value < 2.0 for name, value in start.items())
