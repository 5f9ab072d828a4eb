"""Sets of effects beside the base model, each refitted, and what makes one of them likelier than another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ambid.diagnosis.candidates import Ranking
from ambid.diagnosis.evidence import INEXACT, NAMELESS, OF_FORMULAS, SHAPE_OF_FORMULAS, Evidence, Yardstick
from ambid.diagnosis.nameless import Shown, Ways
from ambid.diagnosis.task import Task
from ambid.effects import Effect
from ambid.identification.problem import ROUGHLY
from ambid.noise import Comparison, compare

NEARNESS = 0.5
"""Of something that has no name a set of the catalogue leaves no larger share x than in x^0.5 of all machines: exponent
0.52 +- 0.11 by maximum likelihood over 21 that were drawn at random."""
FAR_BEHIND = 30.0
"""Log evidence by which a set is of no account beside another that explains the records."""
Names = frozenset[str]


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
    parts : mapping of (frozenset of str, str) to float
        Part of what a set left that a refit of an effect beside it took away.
    nameless : mapping of frozenset of str to Hypothesis
        By the names of a set, that beside a shape that has no name, in the place of an effect.
    whole : Ranking or None
        Of all known effects beside the root, whichever of them are proposed: something else acts in their ways.
    """

    yardstick: Yardstick
    tried: Mapping[Names, Hypothesis] = field(default_factory=dict)
    rankings: Mapping[Names, Ranking] = field(default_factory=dict)
    root: Names = frozenset()
    parts: Mapping[tuple[Names, str], float] = field(default_factory=dict)
    nameless: Mapping[Names, Hypothesis] = field(default_factory=dict)
    whole: Ranking | None = None

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
        sets = (*self.tried.values(), *self.nameless.values())
        return max((h.evidence for h in sets), key=lambda own: own.alone)

    def alone(self, own: Evidence) -> float:
        """Log evidence of a set where nothing else is missing, up to what all have in common."""
        return -0.5 * self._above(own) - own.price() - self._lowest.against

    @property
    def ways(self) -> Ways:
        """In which something else may change the response, as the effects do."""
        return Ways() if self.whole is None else self.whole.ways

    def beside(self, own: Evidence, shape: float = 0.0, prior: float = NAMELESS) -> float:
        """The same beside something else that has no name and shows a shape of such a score, or what formulas leave."""
        return own.beside(self._left(own), self._lowest, self.ways.powers, shape, prior)

    def shown_by(self, hypothesis: Hypothesis) -> Shown:
        """What the residual of a set shows of something else."""
        if hypothesis.names not in self._shown:
            residual = hypothesis.fit.noise.residual(hypothesis.fit.model)
            self._shown[hypothesis.names] = self.ways.shown(residual, hypothesis.effects)
        return self._shown[hypothesis.names]

    @cached_property
    def _shown(self) -> dict[Names, Shown]:
        """Of the sets that were asked for."""
        return {}

    def besides(
        self, hypothesis: Hypothesis, shape: float = 0.0, changing: float = 0.0, *, is_clean: bool = True
    ) -> tuple[float, float]:
        """Log evidence of a set beside what its formulas leave, and beside something else.

        By what J leaves, or by what the residual shows in the ways of effects: noise alone is as unlikely as either
        says. Where J is within chance these alone speak, also against something that they do not show. A set that
        leaves what is not clean has not left it by its formulas, nor what is shown beyond what they may leave.
        Something that changes during the records shows between the lines, where J does not look: `changing` is the log
        of its odds.
        """
        own, shown = hypothesis.evidence, self.shown_by(hypothesis)
        nearer = replace(self._lowest, cost=min(self._lowest.cost, own.cost - shown.explains))
        alone, left = self.alone(own), self.beside(own, shape, prior=0.0)
        seen = alone + self._lowest.against - nearer.against + shown.odds
        if self.left_by(hypothesis) or shape:
            seen = max(left, seen)
        of_formulas = -np.inf
        if is_clean and self.is_of_formulas(hypothesis):
            is_measured = all(part.noise_is_measured for part in hypothesis.fit.noise.in_time)
            share = OF_FORMULAS if is_measured else SHAPE_OF_FORMULAS
            more = shown.beyond - max(self.left_by(hypothesis), self.left_by_formulas(hypothesis, share))
            of_formulas = max(left, seen - 0.5 * max(0.0, more)) + INEXACT
        return of_formulas, max(seen, alone + changing if changing else -np.inf) + NAMELESS

    def stood_in_for(self, hypothesis: Hypothesis, shape: float = 0.0) -> Iterator[tuple[Hypothesis, float]]:
        """Sets within a set, and how much likelier something else that acts as its other effects do is than these.

        It acts as one of them as likely as another, and as no disturbance, which has lines of its own. How near it
        comes was measured, see `NEARNESS`.
        """
        if (ranking := self.whole) is None:
            return
        prior = self.yardstick.prior
        least = max(self.left_by(hypothesis), self.shown_by(hypothesis).beyond, shape, ranking.told_apart)
        for rest in self.tried.values():
            if self._waves(hypothesis) <= rest.names < hypothesis.names:
                near = NEARNESS * float(np.log(least / max(least, self.left_by(rest))))
                of_others = [prior[name] for name in hypothesis.names - rest.names if name in prior]
                by_prior = sum(float(np.log(len(prior) * own)) for own in of_others)
                yield rest, near - by_prior

    def felt(self, names: Names, effect: str) -> Field:
        """The field that remembers what a refit beside a set took away, within what two descents may miss."""
        before, after = (self.tried[own].evidence.cost for own in (names, names | {effect}))
        part = (before - after + ROUGHLY * before) / self._room(self.tried[names])
        return replace(self, parts={**self.parts, (names, effect): part})

    def felt_before(self, hypothesis: Hypothesis, effect: str, likes: Names) -> float | None:
        """Fall of J by an effect, as refits of it beside smaller sets found it; None where there are none.

        Without its likes it stood in for them, or might not: what it takes beside these is another thing.
        """
        own = [(names, part) for (names, name), part in self.parts.items() if name == effect and names in self.tried]
        falls = [part * self._room(self.tried[names]) for names, part in own if likes <= names < hypothesis.names]
        return max(falls, default=None)

    def fall_beside(self, hypothesis: Hypothesis, effect: str) -> float | None:
        """The same by a refit beside the set itself, in whatever noise."""
        part = self.parts.get((hypothesis.names, effect))
        return None if part is None else part * self._room(hypothesis)

    def _room(self, hypothesis: Hypothesis) -> float:
        """What a set leaves that an effect may take, as parts of it are remembered."""
        return max(1.0, self.left_by(hypothesis))

    def left_by(self, hypothesis: Hypothesis) -> float:
        """What a set leaves beyond noise, of J."""
        return self._left(hypothesis.evidence)

    def _left(self, own: Evidence) -> float:
        return self._lowest.beyond + max(0.0, self._above(own))

    def _above(self, own: Evidence) -> float:
        """J of a set above that of the set that comes nearest to noise, but for what formulas leave as a rule."""
        above = own.cost - self._lowest.cost
        return above if above < 0.0 else max(0.0, above - self._of(own, own.usual_errors))

    def of_formulas(self, own: Evidence) -> float:
        """J that the formulas of a set may leave, of what each effect explains beside the others."""
        return self._of(own, own.formula_errors)

    def _of(self, own: Evidence, errors: Mapping[Names, float]) -> float:
        return sum(error * max(0.0, self._least_within(rest) - own.cost) for rest, error in errors.items())

    def _least_within(self, names: Names) -> float:
        """Least J of a set and of those within it, as far as they were tried."""
        if names not in self._least:
            tried = [own.evidence.cost for within, own in self.tried.items() if within <= names]
            self._least[names] = min([self.unexplained.cost, *tried])
        return self._least[names]

    @cached_property
    def _least(self) -> dict[Names, float]:
        """Of the sets that were asked for."""
        return {}

    def worth(self, hypothesis: Hypothesis) -> float:
        """Log evidence of a set, whatever is beside it."""
        return float(np.logaddexp.reduce([self.alone(hypothesis.evidence), *self.besides(hypothesis)]))

    def _worth(self, own: Evidence) -> float:
        """The same of a set that need not be fitted."""
        return float(np.logaddexp(self.alone(own), self.beside(own)))

    def is_of_formulas(self, hypothesis: Hypothesis) -> bool:
        """Whether what a set leaves beyond noise is so little of what it explains that its formulas may leave it.

        They leave a part of it in all records, those to validate on included. Those of a disturbance leave nothing, and
        it has lines of its own; nor do those of what explains nothing.
        """
        left = self.left_by_formulas(hypothesis)
        return bool(hypothesis.added) and left > 0.0 and hypothesis.evidence.beyond <= left

    def left_by_formulas(self, hypothesis: Hypothesis, share: float = OF_FORMULAS) -> float:
        """J that the formulas of a set may leave, such a share of what it explains and of what it leaves."""
        own = hypothesis.evidence
        explains = self.without_physics(hypothesis).cost - own.cost
        return max(share * (explains + own.beyond), self.of_formulas(own))

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
        before, left = self.unexplained.beyond, hypothesis.evidence.beyond
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

    def bar(self, hypothesis: Hypothesis, effect: Effect) -> float:
        """J of the fitted records above which a set with an effect more is of no account, where another explains them.

        The formula of the effect may leave a part of what it explains.
        """
        if not self.is_explained:
            return np.inf
        best, may_leave = self.foremost, effect.leaves_as_a_rule * hypothesis.fit.cost
        return best.fit.cost + 2.0 * (best.evidence.price() + FAR_BEHIND) + may_leave

    def with_(
        self, added: tuple[Effect, ...], fit: Comparison, variants: float = 1.0, *, is_priced: bool = True
    ) -> Field:
        """The field with a further set, or with a better fit of it."""
        other = self.yardstick.kept_back
        kept_back = None if other is None else other.of(fit.model).with_own_angles()
        evidence = self.yardstick.evidence(fit, kept_back, added, variants, is_priced=is_priced)
        further = Hypothesis(added, fit, kept_back, variants, evidence)
        known = self.tried.get(further.names)
        if known is not None and known.evidence.alone >= further.evidence.alone:
            return self
        return replace(self, tried={**self.tried, further.names: further})


def begun(task: Task, base: Comparison, *others: Comparison) -> Field:
    """The field with the base model alone; of an unstable one, with each of what makes it stable, the best first."""
    kept_back = compare(base.model, task.validate) if task.validate else None
    added = [task.beside_nominal(fit.model) for fit in (base, *others)]
    field_ = Field(Yardstick(base, kept_back, task.prior), root=frozenset(effect.name for effect in added[0]))
    for own, fit in zip(added, (base, *others), strict=True):
        field_ = field_.with_(own, fit)
    return field_
