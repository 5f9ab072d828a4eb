"""Each named effect with its near twins: what shares a trait with it, and does nearly as well in its place."""

from collections.abc import Sequence

import numpy as np

from ambid.diagnosis.hypotheses import Field, Hypothesis
from ambid.diagnosis.result import Family
from ambid.diagnosis.search import traits_of
from ambid.effects import Effect, Trait

NEAR = 20.0
"""Log evidence by which a set with a twin may fall behind, where both reach the noise."""
AGREED = 1.2
"""Ratio of the largest to the smallest value up to which the members of a family agree upon one number."""


def families(field: Field, best: Hypothesis) -> dict[str, Family]:
    """Each effect of a set with its near twins, and what all of them share.

    Near twins share a trait with it and, in its place, are little less likely, or leave less than the effect explains.
    """
    found = {}
    for effect in best.added:
        own = traits_of(effect, best.fit.model)
        twins = [(other, traits_of(other, there.fit.model)) for other, there in _in_place_of(field, best, effect)]
        shared = [trait for trait in own if any(trait in traits for _, traits in twins)]
        if not shared:
            continue
        # the trait that most of them have; of several the narrowest
        trait = max(shared, key=lambda trait: sum(trait in traits for _, traits in twins))
        members = [(effect, own), *((other, traits) for other, traits in twins if trait in traits)]
        values = tuple(float(traits[trait]) for _, traits in members)
        names = tuple(other.name for other, _ in members)
        found[effect.name] = Family(names, shared_value(trait, values), values, trait.unit)
    return found


def _in_place_of(field: Field, best: Hypothesis, effect: Effect) -> list[tuple[Effect, Hypothesis]]:
    """What was tried in the place of an effect and does nearly as well, the best first."""
    rest = best.names - {effect.name}
    near = []
    for names, own in field.tried.items():
        if len(names) == len(best.names) and rest < names and effect.name not in names:
            is_near = field.worth(own) > field.worth(best) - NEAR
            is_better_than_nothing = rest in field.tried and field.left_by(own) < 0.5 * field.left_by(field.tried[rest])
            if is_near or is_better_than_nothing:
                (other,) = (each for each in own.added if each.name not in rest)
                near.append((other, own))
    return sorted(near, key=lambda pair: field.worth(pair[1]), reverse=True)


def shared_value(trait: Trait, values: Sequence[float]) -> str:
    """The number of the first, and from where to where it goes where they do not agree; none where none has one."""
    known = [value for value in values if np.isfinite(value)]
    if not known:
        return f"{trait.what} {trait.where}"
    what = trait.what
    if known[0] < 0.0 and trait.opposite:
        what, known = trait.opposite, [-value for value in known]
    low, high = min(known), max(known)
    factor, unit = {"s": (1e3, "ms"), "1": (1e2, "%")}.get(trait.unit, (1.0, trait.unit))
    size, least, most = (f"{factor * value:#.2g}".removesuffix(".") for value in (known[0], low, high))
    is_one = 0.0 < high <= AGREED * low or 0.0 > low >= AGREED * high
    spread = "" if is_one else f" ({least} to {most} among them)"
    return f"{what} of {size} {unit}{spread} {trait.where}"
