"""Is nothing left but noise? Every test that a model must pass, and the one correction for their number.

What a test measures is a power over that of noise: 1 on average where the model is right, and F-distributed. J/dof
comes first, at the level `RARE`. What it does not see is asked where it is within its limit, by tests that share `RARE`
after Holm (Scand. J. Stat. 6 (1979) 65): of m, the one with the smallest p-value has the level `RARE` / m, the next
``RARE / (m - 1)``, until one is passed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc, fdtrc, fdtri

from ambid.findings import NOWHERE, Finding, Kind, Where
from ambid.noise.chance import ADEQUATE, RARE, misfit_bound

ABOVE_LIMIT = Kind(
    "misfit_above_limit",
    "warning",
    "the model is inconsistent with the data: misfit {misfit:{limit}|against}, limit {limit:{misfit}|against} (J/dof)",
)
WITHIN = "(misfit {misfit:{limit}|against}, within its limit {limit:{misfit}|against})"
TOO_MUCH_LEFT = Kind(
    "residual_inconsistent",
    "warning",
    "the model is inconsistent with the data: the residual has {ratio:{most}|against} times the power of the noise "
    f"{{when}}, limit {{most:{{ratio}}|against}} {WITHIN}",
)
NONLINEAR = Kind(
    "nonlinear_residual",
    "warning",
    "the model is inconsistent with the data: what is left acts as a {port}, is {kind} and looks like {shape} "
    f"{WITHIN}",
)
CURVED = Kind(
    "curved_force_inconsistent",
    "warning",
    "the model is inconsistent with the data: misfit {misfit:{limit}|against}, limit {limit:{misfit}|against} (J/dof), "
    "but the curved force of a single magnet is seen: K_i and K_s change during the motion",
)
INCONSISTENT = {
    "misfit": ABOVE_LIMIT,
    "curvature": CURVED,
    "power": TOO_MUCH_LEFT,
    "motion": TOO_MUCH_LEFT,
    "shape": NONLINEAR,
}
"""What is found of a model that fails a test. Those of a diagnosis have findings of their own."""
WHEN = {"power": "in all", "motion": "in motion"}


@dataclass(frozen=True)
class Criterion:
    """One test, and what it found.

    Attributes
    ----------
    name : str
        ``misfit``, ``power``, ``motion``, ``shape``, ``curvature``, ``line``, ``drift``, ``ways`` or
        ``validation``.
    statistic : float
        Over what noise brings on average.
    degrees, against : float
        Of freedom of its F distribution: of what is left, and of the noise that it is held against, where estimated.
    trials : float
        Of how many independent ones it is the largest (Bonferroni).
    least : float
        Up to which it does not matter, however sure it is.
    level : float
        How likely noise alone is to pass the limit.
    where : Where
        Record and channel.
    values : mapping of str to object
        What is to be known beside it.
    """

    name: str
    statistic: float
    degrees: float
    against: float = np.inf
    trials: float = 1.0
    least: float = 0.0
    level: float = RARE
    where: Where = NOWHERE
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def p_value(self) -> float:
        """How likely noise alone brings as much."""
        if np.isinf(self.against):
            return min(1.0, self.trials * float(chdtrc(self.degrees, self.degrees * self.statistic)))
        return min(1.0, self.trials * float(fdtrc(self.degrees, self.against, self.statistic)))

    @property
    def by_chance(self) -> float:
        """What noise alone passes so rarely as the level says."""
        chance = self.level / self.trials
        if np.isinf(self.against):
            return misfit_bound(self.degrees, chance, spread=1.0)
        return float(fdtri(self.degrees, self.against, 1.0 - chance))

    @property
    def limit(self) -> float:
        """Up to which the model passes."""
        return max(self.by_chance, self.least)

    @property
    def fails(self) -> bool:
        """Whether more is left than the limit."""
        return not self.statistic <= self.limit

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "test": self.name,
            "statistic": self.statistic,
            "limit": self.limit,
            "p_value": self.p_value,
            "where": str(self.where) or None,
        }


def misfit_criterion(misfit: float, dof: int, spread: float) -> Criterion:
    """J/dof against its bound, where the standard deviation of J is so many times ``sqrt(2 dof)``."""
    return Criterion("misfit", misfit, dof / spread**2, least=ADEQUATE)


@dataclass(frozen=True)
class Adequacy:
    """The tests that were made, and what a model makes of them.

    Attributes
    ----------
    tests : tuple of Criterion
        Those that the model fails, then those that it passes, each by the p-value; none where the noise is unknown.
    """

    tests: tuple[Criterion, ...] = ()

    @classmethod
    def of(cls, *stages: Iterable[Criterion]) -> Adequacy:
        """Make tests stage by stage, the dear ones last, until the model fails one."""
        found = cls()
        for stage in stages:
            if found.failed():
                break
            found = found.beside(*stage)
        return found

    def beside(self, *more: Criterion) -> Adequacy:
        """The same with further tests, for whose number all are corrected."""
        made = sorted((*self.tests, *more), key=lambda own: own.p_value if own.statistic > own.least else 1.0)
        first, rest = ([own for own in made if (own.name == "misfit") is is_first] for is_first in (True, False))
        level = RARE
        for k, own in enumerate(rest):
            if k == 0 or rest[k - 1].fails:
                level = RARE / (len(rest) - k)
            rest[k] = replace(own, level=level)
        return Adequacy(tuple(sorted((*first, *rest), key=lambda own: not own.fails)))

    @property
    def is_adequate(self) -> bool:
        """Whether nothing is left but noise, as far as these tests see."""
        return bool(self.tests) and not self.failed()

    @property
    def is_within(self) -> bool:
        """Whether no more power is left than that of noise, whatever its shape."""
        return bool(self.tests) and not self.failed("misfit", *WHEN)

    def failed(self, *names: str) -> tuple[Criterion, ...]:
        """The tests that the model fails, of these names or of any, worst first."""
        return tuple(own for own in self.tests if own.fails and (own.name in names or not names))

    @property
    def misfit(self) -> Criterion | None:
        """J/dof against its bound; None where the noise is not known."""
        return next((own for own in self.tests if own.name == "misfit"), None)

    @property
    def bound(self) -> float:
        """Misfit up to which a model is good enough; NaN where the noise is not known."""
        return np.nan if self.misfit is None else self.misfit.limit

    @property
    def finding(self) -> Finding | None:
        """That the model is inconsistent with the data, by what it fails worst; None where it passes all."""
        worst, misfit = next(iter(self.failed(*INCONSISTENT)), None), self.misfit
        if worst is None or misfit is None:
            return None
        own: dict[str, Any] = dict(worst.values)
        if worst.name in WHEN:
            own |= {"ratio": worst.statistic, "most": worst.limit, "when": WHEN[worst.name]}
        return INCONSISTENT[worst.name](NOWHERE, **own, misfit=misfit.statistic, limit=misfit.limit)

    def as_dict(self) -> list[dict[str, Any]]:
        """Plain data, as in JSON."""
        return [own.as_dict() for own in self.tests]
