"""The angle that waves of an effect begin a record at.

An effect counts it from what a channel of the record holds, which is little beside a strong excitation. A record that
was kept back tells it by all of its lines: the response to a wave turns with it, so that J is a cosine over it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ambid.model import Model

__all__ = ["THIRDS", "best_angle", "turned", "undisturbed"]

THIRDS = 2.0 * np.pi / 3.0 * np.arange(3)
"""Angles at which J is asked for."""


def best_angle(costs: list[float]) -> float:
    """Where the cosine that goes through J at `THIRDS` is least [rad]."""
    return float(np.angle(-np.sum(np.array(costs) * np.exp(1j * THIRDS))))


def turned(model: Model, angles: Mapping[str, float]) -> Model:
    """The model with the waves of some effects, by name, turned by angles [rad]."""
    own, values = dict(zip(model.names, model.theta.tolist(), strict=True)), {}
    for effect in model.acting:
        angle = angles.get(effect.name, 0.0)
        for pair in effect.quarters(model.rig):
            a, b = (effect.slot(name) for name in pair)
            values[a] = own[a] * np.cos(angle) - own[b] * np.sin(angle)
            values[b] = own[b] * np.cos(angle) + own[a] * np.sin(angle)
    return model.with_values(values)


def undisturbed(model: Model) -> Model:
    """The model without effects that act as waves."""
    for effect in model.acting:
        model = model.without(effect.name) if effect.quarters(model.rig) else model
    return model
