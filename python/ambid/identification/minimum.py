"""A model at the minimum of J, the misfit in noise units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambid.arrays import FloatArray
from ambid.identification.problem import LeastSquares
from ambid.model import Model
from ambid.noise import Noise

__all__ = ["SUBSTEPS", "Fit", "refit"]

SUBSTEPS = 2
"""Steps per sample of nonlinear effects: neither a choice nor a score needs six digits."""
PENALTY = 4.0
"""What a parameter costs among candidates: it must lower J by more than chance does in 95 % of all records."""


class _WhitenedProblem(LeastSquares):
    """J as a function of all parameters."""

    def __init__(self, model: Model, noise: Noise) -> None:
        super().__init__(model, list(range(len(model.names))), None)
        self.noise, self._near = noise, list[FloatArray]()

    def _evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        found = self.noise.quadratic(self.model.with_theta(theta), self.free, self._near)
        self._near = found.transients
        return found.hessian, found.gradient, found.cost


@dataclass(frozen=True)
class Fit:
    """A model at the minimum of J."""

    model: Model
    cost: float

    @property
    def criterion(self) -> float:
        """J + PENALTY q: fewest parameters win among equals."""
        return self.cost + PENALTY * len(self.model.names)


def refit(model: Model, noise: Noise, most: int = 40) -> Fit:
    """Minimise J over all parameters of the model; of nonlinear effects two steps per sample are exact enough."""
    model = model if model.is_linear else model.with_substeps(SUBSTEPS)
    problem = _WhitenedProblem(model, noise)
    lower = np.array([p.lower for p in model.parameters]) / problem.scale
    upper = np.array([p.upper for p in model.parameters]) / problem.scale
    end = problem.descend(model.theta / problem.scale, (lower, upper), most)
    if end.status == "stopped":
        raise KeyboardInterrupt
    return Fit(model.with_theta(end.theta), end.cost)
