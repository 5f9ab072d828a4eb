"""Name the missing effect: compare, rank, refit the few best, add one, validate, and begin again."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambid.compare import compare
from ambid.diagnosis import Cell, Diagnosis, Step
from ambid.effects import CATALOGUE, Effect, find
from ambid.errors import ModelError, UnstableLoopError
from ambid.fit import fit_percent, measured_outputs, recorded_channels
from ambid.identify import identify
from ambid.model import Model
from ambid.rank import Candidate, Ranking, rank
from ambid.record import Record
from ambid.rig import Rig
from ambid.whitened import Noise, WhitenedProblem
from ambid.yardstick import channel_lines

__all__ = ["diagnose"]

ADEQUATE = 1.10
"""Largest misfit J/dof of a model that is called adequate."""
EQUALLY_GOOD = 9.2
"""Candidates whose J + q ln(dof) is within this of the best cannot be told apart (99 % of a chi-squared with 2 dof)."""
REFITTED = 5
MOST_EFFECTS = 5
EXPLAINED_SHARE = 0.985
"""Part of the excess misfit that a set of effects must explain where its own formulas are approximations."""


@dataclass(frozen=True)
class _Fit:
    """A model at the minimum of J."""

    model: Model
    cost: float

    def criterion(self, lines: int) -> float:
        """J + q ln(dof): fewest parameters win among equals."""
        return self.cost + len(self.model.names) * np.log(lines)


def diagnose(
    model: Model | Rig,
    records: Record | Sequence[Record],
    *,
    validate: Sequence[Record] = (),
    effects: Sequence[str] | None = None,
    catalogue: Sequence[Effect] = CATALOGUE,
    tolerance: float = ADEQUATE,
    say: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Compare, name the missing effect, add it, refit, until nothing more is supported by the data.

    Parameters
    ----------
    model : Model or Rig
        Start; a rig means its nominal values.
    records : Record or sequence of Record
        Three or more periods each.
    validate : sequence of Record
        Not used for choosing; best at another amplitude.
    effects : sequence of str, optional
        A person's own choice: add these, in this order, instead of choosing.
    catalogue : sequence of Effect
        Candidates; effects of your own may be among them.
    tolerance : float
        Misfit J/dof up to which a model is good enough.
    say : callable
        Told about every step.

    Returns
    -------
    Diagnosis

    Raises
    ------
    RecordError
        If a record has fewer than three periods, or no excitation.
    UnstableLoopError
        If the base model has no stable start.
    """
    begun = time.perf_counter()
    records = (records,) if isinstance(records, Record) else tuple(records)
    estimate = identify(model, records)
    if estimate.status == "not_identifiable":
        lost = ", ".join(sorted({name for direction in estimate.directions for name in direction}))
        return Diagnosis.uninformative(estimate.model, records, f"the records do not determine {lost}", begun)
    noise = Noise(estimate.model, records)
    fit = _refit(estimate.model, noise)
    noise = Noise(fit.model, records)
    fit = _refit(fit.model, noise)
    nominal = fit.model.with_values({p.name: p.value for p in estimate.model.parameters})

    base, alternatives = fit, []
    history = [_step(fit, noise, validate, rank(compare(fit.model, records), catalogue, noise=noise), None)]
    say(history[-1].line())
    chosen = [find(name) for name in effects] if effects is not None else None
    while len(fit.model.effects) < MOST_EFFECTS:
        ranking = history[-1].ranking
        if chosen is None and fit.model.effects and history[-1].misfit < tolerance:
            break  # what is left is smaller than what the user calls adequate
        if chosen is not None:
            names = {effect.name for effect in chosen}
            tried = [c for c in ranking.candidates if c.effect.name in names][:1]
        else:
            tried = _worth_refitting(ranking)
        if not tried:
            break
        refits = _refits(fit, nominal, tried, noise)
        if not refits:
            break
        order = sorted(refits, key=lambda pair: pair[1].criterion(noise.lines))
        candidate, better = order[0]
        if chosen is None and better.criterion(noise.lines) > fit.criterion(noise.lines) - EQUALLY_GOOD:
            break
        level = better.criterion(noise.lines) + EQUALLY_GOOD
        alternatives = [c.effect.name for c, other in order if other.criterion(noise.lines) <= level]
        fit = better
        ranking = rank(compare(fit.model, records), catalogue, noise=noise)
        history.append(_step(fit, noise, validate, ranking, candidate))
        say(history[-1].line())
        if chosen is not None:
            chosen = [effect for effect in chosen if effect.name != candidate.effect.name]
    fit, history = _prune(fit, noise, validate, history, catalogue, records)
    return _verdict(base, fit, noise, history, alternatives, tolerance, records, begun)


def _refit(model: Model, noise: Noise, most: int = 40) -> _Fit:
    """Minimise J over all parameters of the model."""
    free = list(range(len(model.names)))
    problem = WhitenedProblem(model, noise, free)
    lower = np.array([p.lower for p in model.parameters]) / problem.scale
    upper = np.array([p.upper for p in model.parameters]) / problem.scale
    end = problem.descend(model.theta / problem.scale, (lower, upper), most)
    return _Fit(model.with_theta(end.theta), end.cost)


def _refits(fit: _Fit, nominal: Model, tried: Sequence[Candidate], noise: Noise) -> list[tuple[Candidate, _Fit]]:
    """Each candidate added and refitted, from its predicted values, and from typical ones where that was a trap."""
    found = []
    for candidate in tried:
        ends = []
        for base, values in ((fit.model, candidate.start), (_with_effects_of(nominal, fit.model), None)):
            try:
                ends.append(_refit(base.add(candidate.effect, values), noise))
            except (UnstableLoopError, ModelError, ValueError):
                continue
            if ends[-1].cost < ADEQUATE * noise.lines:
                break
        if ends:
            found.append((candidate, min(ends, key=lambda end: end.cost)))
    return found


def _worth_refitting(ranking: Ranking) -> list[Candidate]:
    """The significant candidates whose score is at least half of the best, since scores can err by that much."""
    significant = ranking.significant
    best = max((candidate.score for candidate in significant), default=0.0)
    return [candidate for candidate in significant if candidate.score >= 0.5 * best][:REFITTED]


def _with_effects_of(nominal: Model, model: Model) -> Model:
    """The nominal values of the base parameters, the present ones of the effects."""
    own = {p.name: p.value for p in nominal.parameters if p.name in model.names}
    return model.with_values(own)


def _prune(
    fit: _Fit,
    noise: Noise,
    validate: Sequence[Record],
    history: list[Step],
    catalogue: Sequence[Effect],
    records: Sequence[Record],
) -> tuple[_Fit, list[Step]]:
    """Take out effects that a later one has made needless."""
    for effect in fit.model.effects[:-1]:
        less = _refit(fit.model.without(effect.name), noise)
        if less.criterion(noise.lines) <= fit.criterion(noise.lines):
            fit = less
            ranking = rank(compare(fit.model, records), catalogue, noise=noise)
            history = [*history, replace(_step(fit, noise, validate, ranking, None), removed=effect.name)]
    return fit, history


def _step(fit: _Fit, noise: Noise, validate: Sequence[Record], ranking: Ranking, added: Candidate | None) -> Step:
    dof = noise.lines - len(fit.model.names)
    misfit = None
    if validate:
        own = Noise(fit.model, validate)
        residual = own.residual(fit.model)
        misfit = float(residual @ residual) / own.lines
    return Step(
        effects=tuple(effect.name for effect in fit.model.effects),
        fit_percent=_fits(fit.model, noise.records),
        validation_fit_percent=_fits(fit.model, validate) if validate else None,
        misfit=fit.cost / dof,
        validation_misfit=misfit,
        predicted_misfit=None if added is None else added.predicted_misfit,
        ranking=ranking,
        parameters={p.name: p.value for p in fit.model.parameters},
    )


def _fits(model: Model, records: Sequence[Record]) -> dict[str, float]:
    channels = [c for c in recorded_channels(records[0]) if all(c in recorded_channels(r) for r in records)]
    simulated = [model.loop.simulate(model.theta, model.excitation(record)) for record in records]
    return fit_percent(channels, [measured_outputs(r) for r in records], simulated)


def _verdict(
    base: _Fit,
    fit: _Fit,
    noise: Noise,
    history: list[Step],
    alternatives: list[str],
    tolerance: float,
    records: tuple[Record, ...],
    begun: float,
) -> Diagnosis:
    dof = noise.lines - len(fit.model.names)
    misfit = fit.cost / dof
    effects = tuple(effect.name for effect in fit.model.effects)
    share = 1.0 if base.cost <= dof else (base.cost - fit.cost) / (base.cost - dof)
    notes = []
    if not effects:
        verdict = "adequate" if misfit < tolerance else "none_of_the_candidates"
    elif misfit < tolerance:
        verdict = "ambiguous" if len(alternatives) > 1 else "explained"
    elif share > EXPLAINED_SHARE:
        verdict = "ambiguous" if len(alternatives) > 1 else "explained"
        notes.append(
            f"the effects explain {100 * share:.1f} % of the excess misfit; J/dof {misfit:.2f} remains, since their "
            "formulas only approximate this machine"
        )
    else:
        verdict = "none_of_the_candidates"
        notes.append(
            f"best tried: {', '.join(effects)}, which explains {100 * share:.0f} % of the excess misfit; not added"
        )
        fit, effects = base, ()
    where = _where(fit.model, noise, records)
    return Diagnosis(
        verdict=verdict,
        effects=effects,
        ambiguous_sets=[alternatives] if verdict == "ambiguous" else [],
        history=history,
        where=where,
        model=fit.model,
        records=records,
        next_experiment=_next_experiment(verdict, alternatives, where),
        seconds=time.perf_counter() - begun,
        notes=tuple(notes),
    )


def _where(model: Model, noise: Noise, records: Sequence[Record], bands: int = 12) -> list[Cell]:
    """The cells of the map frequency by channel by record in which the misfit is largest."""
    cells = []
    for whitener, record in zip(noise.whiteners, records, strict=True):
        channels = recorded_channels(record)
        simulated = model.loop.simulate(model.theta, model.excitation(record))[:, : len(channels)]
        residual = measured_outputs(record)[:, : len(channels)] - simulated
        alone = channel_lines(residual, whitener.window)
        frequency = whitener.window.excited * record.sample_rate / (whitener.window.period * whitener.window.periods)
        edges = np.geomspace(frequency[0], frequency[-1] * 1.0001, bands + 1)
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            inside = (frequency >= low) & (frequency < high)
            if not inside.any():
                continue
            for k, channel in enumerate(channels):
                misfit = float(np.mean(alone[:, inside, k] ** 2))
                cells.append(Cell(record.name, channel, (float(low), float(high)), misfit, "linear"))
    return sorted(cells, key=lambda cell: -cell.misfit)


def _next_experiment(verdict: str, alternatives: list[str], where: list[Cell]) -> str:
    if verdict == "adequate":
        return "none needed in this band and at this amplitude; a larger amplitude would show nonlinear effects"
    if verdict == "ambiguous":
        return (
            f"to tell {' from '.join(alternatives)}: record i_c where it is missing, else another amplitude, another "
            "bias current or another controller gain; diagnose the old and the new record together"
        )
    if verdict == "explained":
        return "validate on a record at another amplitude or bias current"
    cell = where[0]
    return (
        f"the misfit is largest in {cell.channel} from {cell.band_hz[0]:.0f} to {cell.band_hz[1]:.0f} Hz: repeat at "
        "half and twice the amplitude to see whether it grows with it, and with excitation in that band only"
    )
