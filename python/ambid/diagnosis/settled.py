"""Settings of an effect that are numbers, such as a place or a frequency, moved to where J is least.

An effect is ranked at likely places and at frequencies as they were found. What is millimetres or thousandths of a
hertz beside the truth leaves little of a small effect, and enough of a large one for others to be named beside it.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.candidates import ALPHA
from ambid.diagnosis.ranking import Point
from ambid.effects import Effect
from ambid.effects.places import AtPlace
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.transients import orthonormal

OF_THE_SPAN = 0.3
"""So far may a place go at a time, as a part of the distance of the outermost bearings."""
OF_A_CYCLE = 0.1
"""The same of a frequency, as a part of a cycle over the longest record: J is a parabola over that."""
SMALL = 1e-2
"""Part of that by which a setting is moved for the derivative of the response."""
ROUNDS, FINER = 5, 0.25
"""Steps of Gauss and Newton, at the most, and how much shorter one is tried that leads uphill."""
NEARER = 0.1
"""Fall of J by a step that ends this."""


def settled(fit: Comparison, effect: Effect) -> Comparison:
    """The fit with an effect of its model at its best settings; as it is where chance could lower J as much."""
    best = fit
    names = [name for name in effect.fine if getattr(effect, name) is not None]
    for _ in range(ROUNDS if names else 0):
        further = _nearer(best, effect.name, names)
        if further is None:
            break
        fell, best = best.cost - further.cost, further
        if fell < NEARER:
            break
    return best if fit.cost - best.cost > chdtri(len(names) or 1, ALPHA) else fit


def placed(fit: Comparison, effect: AtPlace, places: Iterable[float | None]) -> Comparison:
    """The fit with an effect of its model at that of some places where it explains most; as it is where that is here.

    A score by a small probe errs where an effect is large, or something else is missing: this one is by its change of
    the response at its values, beside the others at theirs, and by what a linear one can do about these.
    """
    found: dict[float | None, float] = {}
    try:
        without = fit.of(fit.model.without(effect.name))
        point, before = Point(without), fit.noise.departure(without.model)
    except UnstableLoopError:
        return fit
    for z in (effect.z, *places):
        with suppress(UnstableLoopError, ModelError, ValueError):
            there = fit.model if z == effect.z else _with(fit.model, effect, {"z": z})
            changes = (fit.noise.departure(there) - before)[:, None]
            if there.is_linear:
                own = [k for k, name in enumerate(there.names) if name.startswith(f"{effect.name}.")]
                changes = np.hstack([changes, fit.noise.slopes(there, own) * there.theta[own]])
            explains = orthonormal(point.freed(changes.T).T).T @ point.residual
            found[z] = float(np.linalg.norm(explains) if there.is_linear else explains.sum())  # one way, and its sign
    best = max(found, key=lambda z: found[z], default=effect.z)
    if best == effect.z:
        return fit
    try:
        further = refit(fit.of(_with(fit.model, effect, {"z": best})), step=ROUGHLY, bound=fit.cost)
    except (UnstableLoopError, ModelError, ValueError):
        return fit
    return min(fit, further, key=lambda own: own.cost)


def _nearer(fit: Comparison, effect: str, names: list[str]) -> Comparison | None:
    """The fit a step of Gauss and Newton on, settings among the parameters; nothing where none leads downhill."""
    (own,) = (each for each in fit.model.effects if each.name == effect)
    here, farthest = (
        np.array([getattr(own, name) for name in names]),
        np.array([_farthest(fit, name) for name in names]),
    )
    try:
        point, changes = Point(fit), []
        for moved in here + SMALL * np.diag(farthest):
            there = _with(fit.model, own, dict(zip(names, moved.tolist(), strict=True)))
            changes.append((fit.noise.departure(there) - fit.noise.departure(fit.model)) / SMALL)
    except (UnstableLoopError, ModelError, ValueError):
        return None
    step = np.linalg.lstsq(point.freed(np.array(changes)).T, point.residual)[0]
    step *= farthest / max(1.0, float(np.abs(step).max()))
    for part in (1.0, FINER):
        settings = dict(zip(names, (here + part * step).tolist(), strict=True))
        try:
            further = refit(fit.of(_with(fit.model, own, settings)), step=ROUGHLY, bound=fit.cost)
        except (UnstableLoopError, ModelError, ValueError):
            continue
        if further.cost < fit.cost:
            return further
    return None


def _farthest(fit: Comparison, name: str) -> float:
    if name == "z":
        return OF_THE_SPAN * float(np.ptp([bearing.position for bearing in fit.model.rig.bearings]))
    return OF_A_CYCLE / max(part.record.samples / part.record.sample_rate for part in fit.noise.in_time)


def _with(model: Model, effect: Any, settings: Mapping[str, float | None]) -> Model:
    """A model with other settings of one of its effects, at the same values."""
    known = dict(zip(model.names, model.theta.tolist(), strict=True))
    later = model.effects[[own.name for own in model.effects].index(effect.name) + 1 :]
    for own in (effect, *later):
        model = model.without(own.name)
    for own in (replace(effect, **settings), *later):
        prefix = f"{own.name}."
        model = model.add(own, {k.removeprefix(prefix): v for k, v in known.items() if k.startswith(prefix)})
    return model
