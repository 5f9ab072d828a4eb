"""Which effect does the residual ask for: every candidate's score before any of them is refitted.

A candidate's response change psi, whitened, is freed from what refitting the known parameters absorbs,
``psi~ = (I - P_Psi) psi``. The residual e, freed alike, then calls for ``a = argmin |e - psi~ a|`` of it, and

    S = |e|^2 - |e - psi~ a|^2

is chi-squared with as many degrees of freedom as psi has columns where the candidate is absent (Rao's score test;
modification index of structural-equation software). Values that physics forbids are not taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import chi2

from ambid.compare import Comparison
from ambid.effects import CATALOGUE, Effect
from ambid.errors import ModelError, UnstableLoopError
from ambid.loop.assembly import FloatArray
from ambid.model import Model
from ambid.whitened import Noise

__all__ = ["Candidate", "Ranking", "rank"]

ALPHA = 0.01
"""Chance of a false alarm over the whole catalogue."""
CONFUSABLE = 0.9
"""Two candidates whose freed responses have a larger cosine are called confusable."""


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
    p_value : float
        Of the score when the effect is absent.
    start : dict of str to float
        Predicted values of its parameters.
    predicted_misfit : float
        J/dof after adding it, to first order.
    confusable_with : tuple of str
        Candidates that these data can hardly tell from it.
    """

    effect: Effect
    score: float
    degrees: int
    p_value: float
    start: dict[str, float]
    predicted_misfit: float
    confusable_with: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "effect": self.effect.name,
            "score": self.score,
            "p_value": self.p_value,
            "predicted_value": self.start,
            "predicted_misfit": self.predicted_misfit,
            "confusable_with": list(self.confusable_with),
        }


@dataclass(frozen=True, repr=False)
class Ranking:
    """All candidates in the order of their scores per degree of freedom; result of `rank`.

    Attributes
    ----------
    candidates : tuple of Candidate
    misfit : float
        J/dof of the model as it stands.
    skipped : dict of str to str
        Effects that could not be judged, and why.
    """

    candidates: tuple[Candidate, ...]
    misfit: float
    skipped: dict[str, str]

    @property
    def significant(self) -> tuple[Candidate, ...]:
        """Candidates whose score is no chance, at 1 % over the whole catalogue."""
        level = ALPHA / max(1, len(self.candidates))
        return tuple(c for c in self.candidates if c.p_value < level)

    def __repr__(self) -> str:
        lines = [
            f"misfit {self.misfit:.3f} (J/dof, 1 when the model is right)",
            f"{'effect':24s} {'score':>11s} {'p value':>9s} {'misfit then':>12s}  predicted",
        ]
        for c in self.candidates:
            values = ", ".join(f"{name} {value:.3g}" for name, value in c.start.items())
            lines.append(f"{c.effect.name:24s} {c.score:11.1f} {c.p_value:9.2g} {c.predicted_misfit:12.3f}  {values}")
        lines += [f"{name:24s} not judged: {why}" for name, why in self.skipped.items()]
        return "\n".join(lines)


def rank(comparison: Comparison, catalogue: Sequence[Effect] = CATALOGUE, *, noise: Noise | None = None) -> Ranking:
    """Score every effect of a catalogue that the model does not have yet.

    Parameters
    ----------
    comparison : Comparison
        Of a fitted model with its records.
    catalogue : sequence of Effect
        Effects of your own may be among them.
    noise : Noise, optional
        Default: from the model's own residual.

    Returns
    -------
    Ranking
    """
    model = comparison.model
    records = [r.record for r in comparison.records]
    noise = Noise(model, records) if noise is None else noise
    free = list(range(len(model.names)))
    residual, known = noise.jacobian(model, free)
    basis, _ = np.linalg.qr(known / np.linalg.norm(known, axis=0))
    residual = residual - basis @ (basis.T @ residual)
    cost, dof = float(residual @ residual), noise.lines - len(free)

    candidates, directions, skipped = [], [], {}
    present = {effect.name for effect in model.effects}
    for effect in catalogue:
        if effect.name in present or not effect.parameters(model.rig):
            continue
        scored = []
        for variant in effect.variants(model.rig):
            try:
                change = _responses(model, variant, noise)
            except (UnstableLoopError, ModelError) as error:
                skipped[effect.name] = str(error)
                continue
            change = change - basis @ (basis.T @ change)
            scored.append(_score(model, variant, residual, change, cost, dof))
        if scored:
            skipped.pop(effect.name, None)
            candidate, direction = max(scored, key=lambda pair: pair[0].score)
            p_value = min(1.0, len(scored) * candidate.p_value)
            candidates.append(replace(candidate, p_value=p_value))
            directions.append(direction)
    order = sorted(range(len(candidates)), key=lambda k: -candidates[k].score / candidates[k].degrees)
    cosines = np.abs(np.array(directions) @ np.array(directions).T) if directions else np.zeros((0, 0))
    ranked = []
    for k in order:
        near = [candidates[j].effect.name for j in order if j != k and cosines[k, j] > CONFUSABLE]
        ranked.append(replace(candidates[k], confusable_with=tuple(near)))
    return Ranking(tuple(ranked), cost / dof, skipped)


def _responses(model: Model, effect: Effect, noise: Noise) -> FloatArray:
    """Whitened change of the response by each probe of an effect, shape (lines, probes)."""
    return np.column_stack([noise.change(model.add(effect, probe), model) for probe in effect.probes(model.rig)])


def _score(
    model: Model, effect: Effect, residual: FloatArray, change: FloatArray, cost: float, dof: int
) -> tuple[Candidate, FloatArray]:
    size = np.linalg.norm(change, axis=0)
    seen = np.where(size > 0.0, size, 1.0)
    low, high = effect.amplitudes(model.rig)
    found = lsq_linear(change / seen, residual, bounds=(low * seen, high * seen))
    amplitudes = found.x / seen
    fall = max(0.0, cost - 2.0 * found.cost)
    degrees = max(1, int(np.linalg.matrix_rank(change / seen, tol=1e-6)))
    direction = change @ amplitudes
    norm = np.linalg.norm(direction)
    candidate = Candidate(
        effect=effect,
        score=fall,
        degrees=degrees,
        p_value=float(chi2.sf(fall, degrees)),
        start=effect.start(model.rig, amplitudes),
        predicted_misfit=(cost - fall) / (dof - degrees),
    )
    return candidate, direction / norm if norm > 0.0 else direction
