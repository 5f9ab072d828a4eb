"""Probabilities of sets, of effects, of nothing and of something else, by the evidence of all sets that were tried."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid.diagnosis.hypotheses import Field

NEGLIGIBLE = 1e-4
"""Probability below which a set is not listed."""
PRINTED = 0.01
"""Probability from which on a hypothesis is printed."""
IN_PLACE = 0.02
"""How often something without a name is in the place of effects, however little they leave: of 60 that were stated with
98 % and more on machines drawn at random none was not there (Laplace's rule of succession)."""


@dataclass(frozen=True)
class SetProbability:
    """A set of effects with its probability.

    Attributes
    ----------
    effects : tuple of str
        In the order of their adding; none where the set is empty.
    probability : float
        Alone, or beside what its formulas leave.
    with_something_else : float
        Beside something else that has no name.
    """

    effects: tuple[str, ...]
    probability: float
    with_something_else: float

    @property
    def total(self) -> float:
        """Whatever is beside it."""
        return self.probability + self.with_something_else

    def as_dict(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "effects": list(self.effects),
            "probability": self.total,
            "with_something_else": self.with_something_else,
        }


@dataclass(frozen=True)
class Probabilities:
    """What the records say of every hypothesis; sums to one over the sets.

    Attributes
    ----------
    sets : tuple of SetProbability
        Most probable first.
    """

    sets: tuple[SetProbability, ...] = ()

    @property
    def effects(self) -> dict[str, float]:
        """Of each effect, the most probable first."""
        found: dict[str, float] = {}
        for own in self.sets:
            for name in own.effects:
                found[name] = found.get(name, 0.0) + own.total
        return dict(sorted(found.items(), key=lambda pair: -pair[1]))

    @property
    def nothing(self) -> float:
        """That nothing is missing."""
        return sum(own.probability for own in self.sets if not own.effects)

    @property
    def something_else(self) -> float:
        """That something is missing that has no name."""
        return sum(own.with_something_else for own in self.sets)

    @property
    def named(self) -> float:
        """That effects of the catalogue are missing."""
        return sum(own.total for own in self.sets if own.effects)

    @property
    def listed(self) -> dict[str, float]:
        """Those that are worth showing, by name, the most probable effect first; empty where nothing was tried."""
        rest = {"nothing missing": self.nothing, "something without a name": self.something_else}
        return {name: p for name, p in (self.effects | rest).items() if p >= PRINTED} if self.sets else {}

    def lines(self) -> list[str]:
        """In words, such as ``loop_delay 97 %, amplifier_bandwidth 3 %``; none where nothing was tried."""
        listed = ", ".join(f"{name} {100.0 * p:.3g} %" for name, p in self.listed.items())
        return [f"probabilities: {listed}"] if listed else []

    def as_dict(self) -> dict[str, float]:
        """As in JSON."""
        own = {name: p for name, p in self.effects.items() if p > NEGLIGIBLE}
        return own | {"nothing": self.nothing, "something_else": self.something_else}


def probabilities(
    field: Field,
    against: float = 0.0,
    local: frozenset[str] = frozenset(),
    shape: float = 0.0,
    changing: float = 0.0,
    clean: frozenset[str] | None = None,
) -> Probabilities:
    """Of all sets of a field: by their evidence, and by how often such statements were true.

    Parameters
    ----------
    field : Field
    against : float
        Log of the odds that other tests than J have against noise alone in what the best set leaves.
    local : frozenset of str
        Effects that parts of the records do not show: no set that holds one of them is taken for an explanation.
    shape : float
        Score of a nonlinear shape that something else shows in what the best set leaves.
    changing : float
        Log of the odds that parameters change during the records.
    clean : frozenset of str, optional
        A set that leaves nothing to these tests, nor do those that hold it.
    """
    weighed: list[tuple[float, tuple[str, ...], bool]] = []
    for own in field.tried.values():
        if own.names & local:
            continue
        is_clean = not against or (clean is not None and clean <= own.names)
        of_formulas, something_else = field.besides(own, shape, changing, is_clean=is_clean)
        weighed.append((field.alone(own.evidence) - (0.0 if is_clean else against), own.effects, False))
        weighed += [(of_formulas, own.effects, False), (something_else, own.effects, True)]
        weighed += [(something_else + odds, rest.effects, True) for rest, odds in field.stood_in_for(own, shape)]
    for rest, own in field.nameless.items():
        names = tuple(name for name in own.effects if name in rest)
        _, something_else = field.besides(own, shape, changing, is_clean=False)
        weighed += [(field.alone(own.evidence) - against, names, True), (something_else, names, True)]
        weighed += [(something_else + odds, within.effects, True) for within, odds in field.stood_in_for(own, shape)]
    most = max(log for log, _, _ in weighed)
    total = sum(np.exp(log - most) for log, _, _ in weighed)
    found: dict[tuple[str, ...], list[float]] = {}
    base = field.base.effects
    found[base] = [0.0, 0.0]
    for log, names, is_else in weighed:
        p = float(np.exp(log - most) / total)
        in_place = IN_PLACE * p if names != base else 0.0
        found.setdefault(names, [0.0, 0.0])[is_else] += p - in_place
        found[base][True] += in_place
    sets = [SetProbability(own_names, *p) for own_names, p in found.items()]
    kept = [own for own in sets if own.total > NEGLIGIBLE or not own.effects]
    return Probabilities(tuple(sorted(kept, key=lambda own: -own.total)))
