"""What a search came to: one of five verdicts, with the facts that it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.apart import Changing, changing
from ambid.diagnosis.drift import Change, largest_change
from ambid.diagnosis.left import shape_of
from ambid.diagnosis.localisation import Cell, Localisation, largest_cell, localise
from ambid.diagnosis.state import State, Task
from ambid.identification.covariance import covariance
from ambid.loop.effect import Tone
from ambid.noise import Comparison
from ambid.noise.chance import ADEQUATE, RARE
from ambid.noise.tones import OUTSTANDING
from ambid.noise.unseen import ShapeLeft
from ambid.record import Measurement, Record

__all__ = ["Verdict", "judged"]

MOST_BY_SHARE = 2
"""So many effects may be called an explanation by the share that they explain; more must reach the noise."""
EXPLAINED_SHARE = 0.985
"""Part of the excess misfit that a set of effects must explain where its own formulas are approximations."""
OVERTURNS = 65.0
"""Power of a change during a record that overturns a verdict: what has none stays below it, and one of half a per cent
of K_i on four axes has 200. Smaller ones are told beside it."""
BEYOND_NOISE = 3.0
"""Standard deviations of J above its degrees of freedom that are more than noise."""
OTHER_AMPLITUDE = 0.2
"""Relative difference of the excitation's rms that makes it another amplitude."""


@dataclass(frozen=True)
class Verdict:
    """The facts of a verdict.

    Attributes
    ----------
    word : str
        One of `result.VERDICTS`.
    effects : tuple of str
        That explain the misfit, in order.
    sets : tuple of tuple of str
        Effects that these data cannot tell apart.
    fit : Comparison
        Of the last model; of the base model where nothing is explained.
    where : Localisation
        Of the base model.
    misfit : float
        J/dof of the last model that was tried.
    tolerance : float
        Misfit up to which a model is good enough.
    share : float
        Part of the excess misfit of the base model that is explained, 0 to 1.
    tones : tuple of Tone
        That stand out in what is left.
    change : Change or None
        Parameter that changes in what is left.
    tried : tuple of str
        Effects of the best model that was tried where nothing leads to an explanation.
    tried_share : float
        Part of the excess misfit that they explain.
    others : str
        What the explanation holds for beside one record: ``operating points``, ``amplitudes`` or nothing.
    is_stopped : bool
    is_chosen : bool
        Whether a person has chosen the effects.
    changes : tuple of Changing
        What is left where the effects explain each of several operating points by itself.
    remains : Cell or None
        Where most is left by the effects that explain.
    kept_back : float or None
        Misfit of the last model on the records to validate on, where it is above their bound.
    shape : ShapeLeft or None
        What the last model leaves that is more than noise, and neither linear nor of a name, where that decides.
    """

    word: str
    effects: tuple[str, ...]
    sets: tuple[tuple[str, ...], ...]
    fit: Comparison
    where: Localisation
    misfit: float
    tolerance: float
    share: float
    tones: tuple[Tone, ...]
    change: Change | None
    tried: tuple[str, ...]
    tried_share: float
    others: str
    is_stopped: bool
    is_chosen: bool
    changes: tuple[Changing, ...]
    remains: Cell | None
    kept_back: float | None
    shape: ShapeLeft | None

    @property
    def is_to_the_noise(self) -> bool:
        """Whether the last model leaves no more than chance, or than is good enough, leaves."""
        return self.misfit <= max(self.tolerance, self.fit.bound) and self.fit.loudest <= self.tolerance

    @property
    def shows_elsewhere(self) -> bool:
        """Whether records to validate on show what those that the model was fitted to do not."""
        is_named = self.word != "none_of_the_candidates"
        return self.kept_back is not None and (is_named or self.is_to_the_noise)

    @property
    def is_only_good_enough(self) -> bool:
        """Whether it is called adequate while more than chance is left."""
        return self.word == "adequate" and self.misfit > self.fit.by_chance


def judged(task: Task, state: State, tolerance: float, *, is_stopped: bool = False) -> Verdict:
    """The verdict on the last step of a search.

    Parameters
    ----------
    task : Task
    state : State
    tolerance : float
        Misfit J/dof up to which a model is good enough.
    is_stopped : bool
        Whether a person ended the search before its end.
    """
    misfit, share = state.fit.misfit, state.explained
    effects = tuple(effect.name for effect in state.added)
    where = localise(state.base)
    left = state.fit.renewed() if effects else state.fit
    change = largest_change(left) if effects else where.change
    tones = tuple(tone for tone in left.tones if tone.power > OUTSTANDING)
    is_clean = not tones and (change is None or change.power < OVERTURNS)
    has_excess = state.reference.cost > state.at_noise  # without periods, what is missing may be within the noise
    by_share = has_excess and state.explained_by_physics > EXPLAINED_SHARE and len(state.physics) <= MOST_BY_SHARE
    is_at_noise, shape = _is_at_noise(task, state), None
    if effects and is_at_noise and not by_share:
        shape = shape_of(state)
        is_at_noise = shape is None
    elif not effects and tolerance <= ADEQUATE:
        shape = left.shape
    changes = () if is_at_noise or is_stopped or not is_clean else changing(state)
    sets = tuple(state.sets[name] for name in effects if len(state.sets.get(name, ())) > 1)
    fit, tried_share = state.fit, 0.0
    tried: tuple[str, ...] = ()
    is_small = misfit <= max(tolerance, state.at_noise / state.dof) and left.loudest <= tolerance
    kept_back = _beyond_bound(state)
    is_contradicted = shape is not None or kept_back is not None and kept_back > tolerance
    if not effects and is_small and is_clean and not is_contradicted:
        word = "adequate"
    elif effects and (is_at_noise or by_share or changes) and is_clean and (state.physics or is_small):
        word = "ambiguous" if sets else "explained"
    elif is_stopped:
        word = "not_informative"
    else:
        word = "none_of_the_candidates"
    if word == "none_of_the_candidates" and not task.is_chosen:
        best = state.fit if state.hopeless is None else state.hopeless
        tried = tuple(effect.name for effect in best.model.effects[len(state.base.model.effects) :])
        if tried:
            tried_share = state.share_of(best)
        fit, effects, sets = state.base, (), ()
    others = _others(task, state)
    return Verdict(
        word,
        effects,
        sets,
        fit,
        where,
        misfit,
        tolerance,
        share,
        tones,
        change,
        tried,
        tried_share,
        others,
        is_stopped,
        task.is_chosen,
        changes,
        largest_cell(fit, left, change) if word == "explained" else None,
        kept_back,
        shape,
    )


def _is_at_noise(task: Task, state: State) -> bool:
    """Whether nothing but noise is left, or what formulas of the effects are known to leave.

    A record of the same amplitude that was kept back adds to the evidence.
    """
    above = (state.fit.cost - state.dof - state.of_formulas) / (state.fit.noise.scatter * np.sqrt(2.0 * state.dof))
    kept_back = state.history[-1].validation_misfit
    if kept_back is None or state.validation is None or _validated(task, state):
        return bool(above < BEYOND_NOISE)
    other = (kept_back - 1.0 - state.of_formulas / state.dof) * np.sqrt(state.validation.dof / 2.0)
    other /= state.validation.noise.scatter
    return bool(above < BEYOND_NOISE and above + other < BEYOND_NOISE * np.sqrt(2.0))


def _beyond_bound(state: State) -> float | None:
    """Misfit of the records to validate on, where it is above their bound, and what errors of the fit bring to it.

    The parameters' covariance C of the fit makes the J of a record with the Hessian H larger by tr(C H) on average:
    the larger, the more a record tells that was kept back. It is bounded as chi-squared with that mean and the variance
    2 tr(C H C H) (Satterthwaite).
    """
    misfit, kept_back = state.history[-1].validation_misfit, state.validation
    if misfit is None or kept_back is None or not misfit > kept_back.bound:
        return None
    free = range(len(kept_back.model.names))
    carried = covariance(state.fit, free) @ kept_back.noise.quadratic(kept_back.model, free).hessian
    mean, square = float(np.trace(carried)), float(np.trace(carried @ carried))
    brought = square / mean * float(chdtri(mean**2 / square, RARE))
    return misfit if misfit > kept_back.bound + brought / kept_back.dof else None


def _others(task: Task, state: State) -> str:
    """What the model was held against beside one amplitude at one operating point."""
    if state.base.model.points:
        return "operating points"
    amplitudes = _amplitudes(state.fit.noise.records)
    differ = bool(amplitudes) and max(amplitudes) > (1.0 + OTHER_AMPLITUDE) * min(amplitudes)
    return "amplitudes" if _validated(task, state) or differ else ""


def _validated(task: Task, state: State) -> bool:
    """Whether a record to validate on has another amplitude than all others."""
    own, other = _amplitudes(state.fit.noise.records), _amplitudes(task.validate)
    return bool(own) and any(all(abs(a / b - 1.0) > OTHER_AMPLITUDE for b in own) for a in other)


def _amplitudes(records: Sequence[Measurement]) -> list[float]:
    """Rms of what drives each record in time; a frequency response tells none."""
    return [record.amplitude for record in records if isinstance(record, Record)]
