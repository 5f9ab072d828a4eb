"""One link of the chain from the base model to the last: a fit, its noise, what competes with it, and the ledger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

from ambid.diagnosis.candidates import Candidate, Ranking
from ambid.diagnosis.moves import moved, standard_errors
from ambid.diagnosis.ranking import Progress
from ambid.diagnosis.result import Step
from ambid.effects import Effect
from ambid.model import Model
from ambid.noise import Comparison, compare
from ambid.record import Measurement

__all__ = ["State", "Task", "nominal_with_effects_of", "noted"]


@dataclass(frozen=True)
class Task:
    """What stays the same during a search.

    Attributes
    ----------
    nominal : Model
        Where the diagnosis began.
    validate : tuple of Record or FrequencyResponse
        Records that are not used for choosing.
    catalogue : tuple of Effect
    progress : callable
    is_chosen : bool
        Whether a person has chosen the effects.
    as_given : tuple of Effect
        Effects that a person has chosen with their settings, which stay.
    """

    nominal: Model
    validate: tuple[Measurement, ...]
    catalogue: tuple[Effect, ...]
    progress: Progress
    is_chosen: bool = False
    as_given: tuple[Effect, ...] = ()


@dataclass(frozen=True)
class State:
    """A step of a search that is done.

    Attributes
    ----------
    base : Comparison
        Without any effect that was added.
    reference : Comparison
        The base with the disturbances that were added, and nothing else.
    fit : Comparison
        With all that was added.
        All three are judged in one noise.
    validation : Comparison or None
        Of the last model with the records to validate on.
    rivals : mapping of str to tuple of Candidate
        What was refitted beside each effect when it was added.
    sets : mapping of str to tuple of str
        Names that do as well as each effect.
    history : tuple of Step
    hopeless : Comparison or None
        The best that was tried where nothing leads to an explanation.
    """

    base: Comparison
    reference: Comparison
    fit: Comparison
    validation: Comparison | None = None
    rivals: Mapping[str, tuple[Candidate, ...]] = field(default_factory=dict)
    sets: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    history: tuple[Step, ...] = ()
    hopeless: Comparison | None = None

    @property
    def added(self) -> tuple[Effect, ...]:
        """What the search has added to the model that it started from."""
        return self.fit.model.effects[len(self.base.model.effects) :]

    @property
    def dof(self) -> int:
        """Degrees of freedom of J."""
        return self.fit.dof

    @property
    def at_noise(self) -> float:
        """J up to which a model may be right."""
        return self.dof * self.fit.by_chance

    @property
    def fall(self) -> float:
        """By how much the effects have lowered J; disturbances left out, which have lines of their own."""
        return self.reference.cost - self.fit.cost

    @property
    def physics(self) -> tuple[Effect, ...]:
        """The effects that were added, but for disturbances, which have lines of their own."""
        return tuple(effect for effect in self.added if not effect.frequencies_hz(self.fit.model.rig))

    @property
    def of_formulas(self) -> float:
        """How much of J the errors of the formulas of the effects may be."""
        own = {effect.name: effect.formula_error for effect in self.added if effect.formula_error}
        falls = [(after.added, before.misfit - after.misfit) for before, after in pairwise(self.history)]
        return self.dof * sum(own[name] * fall for name, fall in falls if name in own)

    @property
    def explained(self) -> float:
        """Part of the excess misfit of the base model that the effects explain, 0 to 1; 1 where there is no excess."""
        return self.share_of(self.fit)

    @property
    def explained_by_physics(self) -> float:
        """The same beside the disturbances, which have lines of their own."""
        excess = self.reference.cost - self.dof
        return 1.0 if excess <= 0.0 else self.fall / excess

    def share_of(self, fit: Comparison) -> float:
        """Part of the excess misfit of the base model that another fit explains, in the same noise, 0 to 1."""
        excess = self.base.cost - self.dof
        return 1.0 if excess <= 0.0 else min(1.0, max(0.0, (self.base.cost - fit.cost) / excess))

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
    validation, misfit = state.validation, None
    if task.validate:
        if validation is None or removed is None:
            validation = compare(state.fit.model, task.validate)
        else:
            validation = validation.of(state.fit.model).with_own_angles()
        misfit = validation.cost / (validation.dof + len(validation.model.free))  # nothing was fitted to them
    after = state.fit.model
    shifted = moved(state.history[-1].model, after, standard_errors(state.fit)) if state.history else ()
    step = Step(
        effects=tuple(effect.name for effect in after.effects),
        fit_percent=state.fit.fit_percent,
        validation_fit_percent=None if validation is None else validation.fit_percent,
        misfit=state.fit.cost / state.dof,
        validation_misfit=misfit,
        predicted_misfit=None if predicted is None else predicted.predicted_misfit,
        ranking=ranking,
        model=after,
        moved=shifted,
        removed=removed,
        added=added if predicted is None else predicted.effect.name,
    )
    return replace(state, validation=validation, history=(*state.history, step))


def nominal_with_effects_of(task: Task, model: Model) -> Model:
    """The nominal values of the base parameters, the present ones of the effects."""
    return model.with_values({p.name: p.value for p in task.nominal.parameters if p.name in model.names})
