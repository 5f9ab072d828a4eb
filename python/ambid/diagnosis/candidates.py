"""What a ranking says: candidates with their evidence, the least likely to be chance first."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.diagnosis.evidence import USUAL, by_score, posterior
from ambid.diagnosis.nameless import Ways
from ambid.effects import Effect
from ambid.findings import Finding, WithFindings
from ambid.noise import Comparison
from ambid.noise.chance import independent_tests, log_chance_bounded
from ambid.results import Named, Tabular, picture, plain

ALPHA = 0.005
"""Chance of a false alarm over the whole catalogue: half of the 1 % that all tests of a diagnosis may have together."""
SAME = 1e-6
"""Part of what a candidate does that another must leave for both to be distinguished at all."""


@dataclass(frozen=True)
class Candidate:
    """One effect, judged by its score.

    Attributes
    ----------
    effect : Effect
    score : float
        Fall of J that adding it would bring, to first order.
    degrees : int
        Degrees of freedom of the score.
    start : dict of str to float
        Predicted values of its parameters.
    predicted_misfit : float
        J/dof after adding it, to first order.
    confusable_with : tuple of str
        Candidates that act on these data much as it does: the cosine of both responses is beyond
        `diagnosis.ranking.CONFUSABLE`.
    smallest_visible : dict of str to float
        Value of each probed parameter that these data would just show; what is smaller stays invisible.
    direction : ndarray, shape (lines,), or None
        Whitened response change, freed from what the known parameters absorb, of unit norm.
    size : float
        Norm of that change at the predicted values.
    residual : ndarray, shape (lines,), or None
        Whitened residual, freed alike, that it was judged by; shared by the candidates of a ranking.
    from_start : bool
        Whether it was judged at the values that the diagnosis started from, no stable loop with it being near the fit.
    spread : float
        What chance brings of a fall of J per degree of freedom: a little more than 1, see `Spectrum`.
    one_sided : int
        So many of the degrees of freedom can only have one sign.
    variants : float
        So many independent places, frequencies or sizes were tried.
    near : tuple of (Effect, dict, float)
        Other variants with a score that is near enough for a refit to decide, those of other laws first, the values
        predicted for them, and their score over that of the best.
    """

    effect: Effect
    score: float
    degrees: int
    start: dict[str, float]
    predicted_misfit: float
    confusable_with: tuple[str, ...] = ()
    smallest_visible: dict[str, float] = field(default_factory=dict)
    direction: FloatArray | None = field(default=None, repr=False, compare=False)
    size: float = 0.0
    residual: FloatArray | None = field(default=None, repr=False, compare=False)
    from_start: bool = False
    spread: float = 1.0
    one_sided: int = 0
    variants: float = 1.0
    near: tuple[tuple[Effect, dict[str, float], float], ...] = field(default=(), repr=False, compare=False)

    @property
    def chance(self) -> float:
        """Logarithm of the p-value: of such a score when the effect is absent, whichever of its variants is best."""
        return self.chance_of(self.score)

    def chance_of(self, score: float) -> float:
        """The same of any score."""
        own = log_chance_bounded(score / self.spread, self.degrees, self.one_sided)
        return min(0.0, own + float(np.log(self.variants)))

    def evidence_against(self, other: Candidate) -> float:
        """Fall of J by this effect that the other one could not bring: ``S (1 - rho^2)``."""
        if self.direction is None or other.direction is None:
            return 0.0
        return self.score * (1.0 - float(self.direction @ other.direction) ** 2)

    @property
    def p_value(self) -> float:
        """Of the score when the effect is absent."""
        return float(np.exp(self.chance))

    @property
    def p_text(self) -> str:
        """The p-value as it is printed: what is smaller than a number can hold ranks nothing."""
        return f"{self.p_value:.2g}" if self.p_value > 1e-300 else "< 1e-300"

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "effect": self.effect.name,
            "score": self.score,
            "p_value": self.p_value,
            "predicted_value": self.start,
            "predicted_misfit": self.predicted_misfit,
            "confusable_with": list(self.confusable_with),
            "smallest_visible": self.smallest_visible,
        }


@dataclass(frozen=True, repr=False)
class Ranking(WithFindings, Tabular):
    """All candidates, least likely to be chance first; result of `rank`.

    Attributes
    ----------
    candidates : tuple of Candidate
    misfit : float
        J/dof of the model as it stands.
    findings : tuple of Finding
        Of each effect that makes no sense on this rig or could not be judged, why; its name is the value ``effect``.
    comparison : Comparison or None
        What it was judged in.
    ways : Ways
        In which the candidates may change the response.
    at_fit : tuple of Candidate
        The same candidates where misfit has driven the model to, if they were judged where it began.
    """

    candidates: tuple[Candidate, ...]
    misfit: float
    findings: tuple[Finding, ...]
    comparison: Comparison | None = None
    ways: Ways = field(default_factory=Ways, repr=False, compare=False)
    at_fit: tuple[Candidate, ...] = ()

    plot = picture("plot_ranking")

    @property
    def not_tried(self) -> dict[str, str]:
        """Effects that make no sense on this rig or could not be judged, and why, in words."""
        return Named({str(finding.values["effect"]): finding.message for finding in self.findings})

    @property
    def notes(self) -> tuple[str, ...]:
        """The findings in words, a line each, with the effect that each is about."""
        return tuple(f"{name} not tried: {why}" for name, why in self.not_tried.items())

    def find(self, name: str) -> Candidate | None:
        """The candidate of that name, if there is one."""
        return next((c for c in self.candidates if c.effect.name == name), None)

    def among(self, names: Collection[str]) -> Ranking:
        """Of some of the effects alone."""
        return replace(
            self,
            candidates=tuple(c for c in self.candidates if c.effect.name in names),
            at_fit=tuple(c for c in self.at_fit if c.effect.name in names),
            findings=tuple(f for f in self.findings if f.values["effect"] in names),
        )

    @cached_property
    def shown(self) -> tuple[Candidate, ...]:
        """The candidates that change the response at all, as these records show it."""
        return tuple(c for c in self.candidates if c.size > 0.0)

    @cached_property
    def cosines(self) -> FloatArray:
        """Between the changes of the response by those, shape (shown, shown)."""
        directions = np.array([c.direction for c in self.shown])
        return np.asarray(directions @ directions.T) if self.shown else np.zeros((0, 0))

    @cached_property
    def told_apart(self) -> float:
        """How many independent changes of the response the candidates are, as far as these records distinguish them."""
        return independent_tests(self.cosines, len(self.cosines)) if len(self.cosines) else 1.0

    def joint_scores(self) -> Iterator[tuple[Candidate, Candidate, float]]:
        """Fall of J, to first order, by each two of them at once, unless that needs a sign that physics forbids."""
        alone = [float(np.dot(c.direction, c.residual)) for c in self.shown]  # type: ignore[arg-type]
        for k, j in combinations(range(len(alone)), 2):
            cosine = self.cosines[k, j]
            own, other = alone[k] - cosine * alone[j], alone[j] - cosine * alone[k]
            is_allowed = all(way > 0.0 or not self.shown[i].one_sided for way, i in ((own, k), (other, j)))
            if is_allowed and cosine**2 < 1.0 - SAME:
                yield self.shown[k], self.shown[j], (alone[k] * own + alone[j] * other) / (1.0 - cosine**2)

    @cached_property
    def probabilities(self) -> dict[str, float]:
        """Of each candidate: that it alone is missing, by its score, or it beside something without a name.

        The rest is that nothing of the catalogue is missing, or more than one; a diagnosis refits, and tries sets.
        """
        if self.comparison is None or not self.candidates:
            return Named()
        usual = -float(np.log(USUAL / (len(self.candidates) + len(self.findings))))
        tried = [by_score(self.comparison, self.misfit, 0.0, 0, 0, 0.0)]
        for c in self.candidates:
            prior = usual + float(np.log(c.variants))
            own = by_score(self.comparison, c.predicted_misfit, c.score, c.degrees, c.one_sided, prior)
            tried.append(own)
        names = [c.effect.name for c in self.candidates]
        return Named(zip(names, posterior(tried, self.ways.powers)[1:].tolist(), strict=True))

    @property
    def significant(self) -> tuple[Candidate, ...]:
        """Candidates whose score is no chance, at `ALPHA` over the whole catalogue."""
        level = ALPHA / max(1, len(self.candidates))
        return tuple(c for c in self.candidates if c.p_value < level)

    def table(self) -> dict[str, list[Any]]:
        """Candidates, a row each, in rank order."""
        return {
            "effect": [c.effect.name for c in self.candidates],
            "score": [c.score for c in self.candidates],
            "p_value": [c.p_value for c in self.candidates],
            "probability": [self.probabilities.get(c.effect.name) for c in self.candidates],
            "predicted_misfit": [c.predicted_misfit for c in self.candidates],
            "predicted_value": [", ".join(f"{n} {v:.3g}" for n, v in c.start.items()) for c in self.candidates],
            "confusable_with": [", ".join(c.confusable_with) for c in self.candidates],
        }

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        rows = [c.as_dict() | {"probability": self.probabilities.get(c.effect.name)} for c in self.candidates]
        return plain(
            {"misfit": self.misfit, "candidates": rows, "not_tried": self.not_tried, **self.findings_as_dict()}
        )

    def summary(self) -> list[str]:
        """Misfit, and what was not tried."""
        return [f"misfit {self.misfit:.3f} (J/dof, 1 when the model is right)", *self.notes]

    def __str__(self) -> str:
        lines = [
            f"misfit {self.misfit:.3f} (J/dof, 1 when the model is right)",
            f"{'effect':24s} {'score':>11s} {'p value':>9s} {'alone':>7s} {'misfit then':>12s}  predicted",
        ]
        for c in self.candidates:
            values = ", ".join(f"{name} {value:.3g}" for name, value in c.start.items())
            alone = f"{100.0 * p:6.1f}%" if (p := self.probabilities.get(c.effect.name)) is not None else " " * 7
            numbers = f"{c.score:11.1f} {c.p_text:>9s} {alone} {c.predicted_misfit:12.3f}"
            lines.append(f"{c.effect.name:24s} {numbers}  {values}")
        lines += [f"{name:24s} not tried: {why}" for name, why in self.not_tried.items()]
        return "\n".join(lines)
