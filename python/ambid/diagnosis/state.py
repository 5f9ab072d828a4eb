"""One link of the chain from the base model to the last: a fit, its noise, what competes with it, and the ledger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ambid.diagnosis.ranking import Candidate, Progress, Ranking
from ambid.diagnosis.result import Step
from ambid.effects import Effect
from ambid.identification.minimum import Fit
from ambid.model import Model
from ambid.noise import Noise
from ambid.noise.fit import fit_percent
from ambid.record import Record

__all__ = ["SPREAD", "State", "Task", "nominal_with_effects_of", "noted"]

SPREAD = 1.5
"""Standard deviation of J in units of sqrt(2 dof): the noise spectrum is estimated too."""


@dataclass(frozen=True)
class Task:
    """What stays the same during a search.

    Attributes
    ----------
    nominal : Model
        Where the diagnosis began.
    validate : tuple of Record
        Records that are not used for choosing.
    catalogue : tuple of Effect
    progress : callable
    """

    nominal: Model
    validate: tuple[Record, ...]
    catalogue: tuple[Effect, ...]
    progress: Progress


@dataclass(frozen=True)
class State:
    """A step of a search that is done.

    Attributes
    ----------
    base : Fit
        Without any effect that was added.
    reference : Fit
        The base with the disturbances that were added, and nothing else.
    fit : Fit
        With all that was added.
    noise : Noise
        In which all three are judged.
    validation_noise : Noise or None
        Of the records to validate on.
    rivals : mapping of str to tuple of Candidate
        What was refitted beside each effect when it was added.
    sets : mapping of str to tuple of str
        Names that do as well as each effect.
    history : tuple of Step
    hopeless : Fit or None
        The best that was tried where nothing leads to an explanation.
    """

    base: Fit
    reference: Fit
    fit: Fit
    noise: Noise
    validation_noise: Noise | None = None
    rivals: Mapping[str, tuple[Candidate, ...]] = field(default_factory=dict)
    sets: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    history: tuple[Step, ...] = ()
    hopeless: Fit | None = None

    @property
    def added(self) -> tuple[Effect, ...]:
        """What the search has added to the model that it started from."""
        return self.fit.model.effects[len(self.base.model.effects) :]

    @property
    def dof(self) -> int:
        """Degrees of freedom of J."""
        return self.noise.lines - len(self.fit.model.names)

    @property
    def at_noise(self) -> float:
        """J up to which a model may be right."""
        return self.dof + 3.0 * SPREAD * np.sqrt(2.0 * self.dof)

    @property
    def fall(self) -> float:
        """By how much the effects have lowered J; disturbances left out, which have lines of their own."""
        return self.reference.cost - self.fit.cost

    @property
    def explained(self) -> float:
        """Part of the excess misfit of the base model that is explained, that of disturbances left out."""
        excess = self.reference.cost - self.dof
        return 1.0 if excess <= 0.0 else self.fall / excess

    @property
    def ranking(self) -> Ranking:
        """Of what is still outside the model."""
        return self.history[-1].ranking

    def without_set(self, name: str) -> dict[str, tuple[str, ...]]:
        """The sets but that of one effect."""
        return {own: names for own, names in self.sets.items() if own != name}


def noted(
    task: Task,
    state: State,
    ranking: Ranking,
    predicted: Candidate | None = None,
    *,
    added: str | None = None,
    removed: str | None = None,
) -> State:
    """The state with its line in the ledger: fit and misfit, also on the records to validate on."""
    validation, own = None, state.validation_noise
    if task.validate:
        if own is None or removed is None:
            own = Noise(state.fit.model, task.validate)
        residual = own.residual(state.fit.model)
        validation = float(residual @ residual) / own.lines
    step = Step(
        effects=tuple(effect.name for effect in state.fit.model.effects),
        fit_percent=_fits(state.fit.model, state.noise.records),
        validation_fit_percent=_fits(state.fit.model, task.validate) if task.validate else None,
        misfit=state.fit.cost / state.dof,
        validation_misfit=validation,
        predicted_misfit=None if predicted is None else predicted.predicted_misfit,
        ranking=ranking,
        model=state.fit.model,
        removed=removed,
        added=added if predicted is None else predicted.effect.name,
    )
    return replace(state, validation_noise=own, history=(*state.history, step))


def nominal_with_effects_of(task: Task, model: Model) -> Model:
    """The nominal values of the base parameters, the present ones of the effects."""
    return model.with_values({p.name: p.value for p in task.nominal.parameters if p.name in model.names})


def _fits(model: Model, records: Sequence[Record]) -> dict[str, float]:
    channels = [c for c in records[0].channels if all(c in r.channels for r in records)]
    simulated = [model.response(record) for record in records]
    return fit_percent(channels, [r.outputs for r in records], simulated)
