"""Settings of an effect that are numbers, such as a place or a frequency, moved to where J is least.

An effect is ranked at likely places and at frequencies as they were found. What is millimetres or thousandths of a
hertz beside the truth leaves little of a small effect, and enough of a large one for others to be named beside it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.candidates import ALPHA
from ambid.effects import Effect
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import ROUGHLY, refit
from ambid.noise import Comparison

__all__ = ["settled"]

OF_THE_SPAN = 0.1
"""First step of a place, as a part of the distance of the outermost bearings."""
OF_A_CYCLE = 0.03
"""First step of a frequency, as a part of a cycle over the longest record: J is a parabola over that."""
FARTHEST = 3.0
"""Steps that a parabola may lead away from where it was found."""
ROUNDS, FINER = 3, 0.25
"""Parabolas, each with steps so much shorter."""


def settled(fit: Comparison, effect: Effect) -> Comparison:
    """The fit with an effect of its model at its best settings; as it is where chance could lower J as much."""
    best = fit
    for name in effect.fine:
        (here,) = (own for own in best.model.effects if own.name == effect.name)
        if getattr(here, name) is not None:
            best = _along(best, here, name, _first_step(fit, name))
    return refit(best) if best is not fit and fit.cost - best.cost > chdtri(len(effect.fine), ALPHA) else fit


def _first_step(fit: Comparison, name: str) -> float:
    if name == "z":
        return OF_THE_SPAN * float(np.ptp([bearing.position for bearing in fit.model.rig.bearings]))
    return OF_A_CYCLE / max(part.record.samples / part.record.sample_rate for part in fit.noise.in_time)


def _along(fit: Comparison, effect: Any, name: str, step: float) -> Comparison:
    """The best fit over one setting of an effect: parabolas through three values each, about the best so far."""
    ends = {getattr(effect, name): fit}

    def cost(value: float) -> float:
        if value not in ends and (tried := _at(fit, replace(effect, **{name: value}))):
            ends[value] = tried
        return ends[value].cost if value in ends else np.inf

    for _ in range(ROUNDS):
        before = min(ends, key=cost)
        below, here, above = cost(before - step), cost(before), cost(before + step)
        bend = below + above - 2.0 * here
        if np.isfinite(bend) and bend > 0.0:
            cost(before + step * float(np.clip(0.5 * (below - above) / bend, -FARTHEST, FARTHEST)))
        if min(ends, key=cost) == before and not bend > 1.0:
            break  # J is flat over it
        step *= FINER
    return min(ends.values(), key=lambda end: end.cost)


def _at(fit: Comparison, effect: Effect) -> Comparison | None:
    """The fit with another variant of an effect in its place; nothing where the rotor is not known there."""
    model, known = fit.model, dict(zip(fit.model.names, fit.model.theta.tolist(), strict=True))
    later = model.effects[[own.name for own in model.effects].index(effect.name) + 1 :]
    for own in (effect, *later):
        model = model.without(own.name)
    try:
        for own in (effect, *later):
            prefix = f"{own.name}."
            model = model.add(own, {k.removeprefix(prefix): v for k, v in known.items() if k.startswith(prefix)})
        return refit(fit.of(model), step=ROUGHLY)
    except (UnstableLoopError, ModelError, ValueError):
        return None
