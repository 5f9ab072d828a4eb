"""Each named effect with its near twins: what shares a trait with it, and looks like it or does nearly as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambid.diagnosis.candidates import Candidate
from ambid.diagnosis.result import Family
from ambid.diagnosis.rivals import is_as_good
from ambid.diagnosis.state import State
from ambid.effects import Effect, Trait
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import ROUGHLY, refit
from ambid.model import Model
from ambid.noise import Comparison

__all__ = ["families"]

WORTH_TRYING = 0.1
"""Part of the named effect's score below which one of its kind is no near twin; scores can err by a factor of two."""
AGREED = 1.2
"""Ratio of the largest to the smallest value up to which the members of a family agree upon one number."""


@dataclass(frozen=True)
class _Member:
    """An effect that does nearly as well, with its traits at its refitted values."""

    name: str
    traits: Mapping[Trait, float]
    cost: float


def families(state: State) -> dict[str, Family]:
    """Each effect that a search has added with its near twins, and what all of them share.

    Near twins share a trait with it. They look like it in the ranking, or, refitted in its place, leave no more than
    chance can make of what it leaves. Where it leaves more than noise its own formula errs by as much, and so may
    theirs. Where none shares a trait, they are all that cannot be told from it or looks like it.
    """
    found = {}
    for effect in state.added:
        own, others = _before(state, effect.name)
        first = _member(effect, state.fit)
        near = _near(state, own, others) if own is not None and first.traits else []
        shared = [trait for trait in first.traits if any(trait in other.traits for other in near)]
        if shared:
            # the trait that most of them have; of several the narrowest
            trait = max(shared, key=lambda trait: sum(trait in other.traits for other in near))
            members = [first, *sorted((m for m in near if trait in m.traits), key=lambda m: m.cost)]
            values = tuple(float(m.traits[trait]) for m in members)
            found[effect.name] = Family(tuple(m.name for m in members), _told(trait, values), values, trait.unit)
        else:
            alike = () if own is None else own.confusable_with
            names = dict.fromkeys((effect.name, *state.sets.get(effect.name, ()), *alike))
            if len(names) > 1:
                found[effect.name] = Family(tuple(names), "")
    return found


def _before(state: State, name: str) -> tuple[Candidate | None, tuple[Candidate, ...]]:
    """An effect in the last ranking that it stood in, and what else stood there."""
    for step in reversed(state.history):
        if (own := step.ranking.find(name)) is not None:
            return own, tuple(other for other in step.ranking.candidates if other is not own)
    return None, ()


def _near(state: State, own: Candidate, others: Sequence[Candidate]) -> list[_Member]:
    """What shares a trait with an effect, and looks like it or does nearly as well in its place."""
    rest = state.fit.model.without(own.effect.name)
    here = {effect.name for effect in rest.effects}
    mine = _traits(own.effect, rest, {})
    found = []
    for other in others:
        is_alike = other.effect.name in own.confusable_with
        if other.effect.name in here or not (is_alike or other.score > WORTH_TRYING * own.score):
            continue
        if mine.keys() & _traits(other.effect, rest, {}).keys():
            fit = _refitted(state, rest, other)
            if fit is not None and (is_alike or _is_near(state, fit)):
                found.append(_member(other.effect, fit))
    return found


def _refitted(state: State, rest: Model, candidate: Candidate) -> Comparison | None:
    """A candidate in the place of an effect, from its predicted values; where these lead nowhere, from typical ones."""
    ends: list[Comparison] = []
    for values in (candidate.start, {}):
        try:
            ends.append(refit(state.fit.of(rest.add(candidate.effect, values)), step=ROUGHLY))
        except (UnstableLoopError, ModelError):
            continue
        own = (p for p in ends[-1].model.parameters if p.name.startswith(f"{candidate.effect.name}."))
        if not any(p.is_at_limit for p in own):
            break
    return min(ends, key=lambda end: end.cost, default=None)


def _is_near(state: State, other: Comparison) -> bool:
    return is_as_good(other, state.fit) or other.cost - state.fit.cost <= state.fit.cost - state.dof


def _member(effect: Effect, fit: Comparison) -> _Member:
    own = {p.name.split(".", 1)[1]: p.value for p in fit.model.parameters if p.name.startswith(f"{effect.name}.")}
    return _Member(effect.name, _traits(effect, fit.model, own), fit.cost)


def _traits(effect: Effect, model: Model, values: Mapping[str, float]) -> Mapping[Trait, float]:
    """Traits of an effect at these of its values, the others being typical ones."""
    rig = model.home_of(effect) or model.rig
    return effect.traits(rig, {p.name: p.probe for p in effect.parameters(rig)} | dict(values))


def _told(trait: Trait, values: Sequence[float]) -> str:
    """The number of the first, and from where to where it goes where they do not agree; none where none has one."""
    known = [value for value in values if np.isfinite(value)]
    if not known:
        return f"{trait.what} {trait.where}"
    low, high = min(known), max(known)
    factor, unit = {"s": (1e3, "ms"), "1": (1e2, "%")}.get(trait.unit, (1.0, trait.unit))
    size, least, most = (f"{factor * value:#.2g}".removesuffix(".") for value in (known[0], low, high))
    spread = "" if 0.0 < high <= AGREED * low else f" ({least} to {most} among them)"
    return f"{trait.what} of {size} {unit}{spread} {trait.where}"
