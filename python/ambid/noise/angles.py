"""The angle that waves of an effect begin a record at.

An effect counts it from what a channel of the record holds, which is little beside a strong excitation. A record that
was kept back determines it by all lines: the response to a wave turns with it, so that J is nearly a cosine over it,
and a parabola about its least.
"""

from collections.abc import Callable, Mapping

import numpy as np

from ambid.model import Model

THIRDS = 2.0 * np.pi / 3.0 * np.arange(3)
"""Angles at which J is asked for."""
BESIDE = (0.03, 0.003)
"""To each side of what is the best so far [rad]: where the cycles of a record are no whole number, J is no cosine, and
a wave a thousand times the noise is known to a thousandth of a radian."""


def best_angle(cost: Callable[[float], float]) -> float:
    """Where J is least [rad]: on the cosine that goes through it at `THIRDS`, then on parabolas beside that."""
    known = {float(angle): cost(float(angle)) for angle in THIRDS}
    found = float(np.angle(-np.sum(np.array(list(known.values())) * np.exp(1j * THIRDS))))
    for step in BESIDE:
        below, here, above = (known.setdefault(angle, cost(angle)) for angle in (found - step, found, found + step))
        bend = below + above - 2.0 * here
        if bend > 0.0:
            found += step * float(np.clip(0.5 * (below - above) / bend, -1.0, 1.0))
    known.setdefault(found, cost(found))
    return min(known, key=known.__getitem__)


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
