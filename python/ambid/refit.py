"""A model at the minimum of J, the misfit in noise units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambid.model import Model
from ambid.rank import SUBSTEPS
from ambid.whitened import Noise, WhitenedProblem

__all__ = ["Fit", "refit"]

PENALTY = 4.0
"""What a parameter costs among candidates: it must lower J by more than chance does in 95 % of all records."""


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
    free = list(range(len(model.names)))
    problem = WhitenedProblem(model, noise, free)
    lower = np.array([p.lower for p in model.parameters]) / problem.scale
    upper = np.array([p.upper for p in model.parameters]) / problem.scale
    end = problem.descend(model.theta / problem.scale, (lower, upper), most)
    if end.status == "stopped":
        raise KeyboardInterrupt
    return Fit(model.with_theta(end.theta), end.cost)
