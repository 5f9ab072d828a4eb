"""The way from the base model to the best set, a step for each effect, with fit, misfit and what was moved."""

from ambid.diagnosis.hypotheses import Field, Hypothesis
from ambid.diagnosis.moves import moved, standard_errors
from ambid.diagnosis.refits import ranked, without
from ambid.diagnosis.result import Step
from ambid.diagnosis.task import Task
from ambid.noise import Comparison


def steps_to(task: Task, field: Field, best: Hypothesis, base: Comparison) -> list[Step]:
    """Every step, the base model first.

    Effects are taken in the order in which the best set got them; what lies between was tried, or is fitted now. Each
    misfit is that of a model in its own noise, as `identify` and `compare` give it; without periods, where own noise
    takes up what is missing, that in the noise of the best set.
    """
    chain = [best]
    for effect in reversed(best.added):
        names = chain[0].names - {effect.name}
        if names not in field.tried:
            field = without(task, field, chain[0], effect)
        if names in field.tried:
            chain.insert(0, field.tried[names])
    steps: list[Step] = []
    is_measured = all(part.noise_is_measured for part in base.noise.parts)
    for before, own in zip([None, *chain], chain, strict=False):
        known = frozenset() if before is None else before.names
        added = [effect for effect in own.added if effect.name not in known]
        predicted = steps[-1].ranking.find(added[0].name) if steps and added else None
        ranking = field.rankings.get(own.names) or ranked(task, own.fit)
        kept_back = own.kept_back
        alone = own.fit.renewed() if is_measured else own.fit
        if is_measured and own.fit.model.effects == base.model.effects:
            alone = base  # as it was fitted in its own noise
        steps.append(
            Step(
                effects=tuple(effect.name for effect in own.fit.model.effects),
                fit_percent=own.fit.fit_percent,
                validation_fit_percent=None if kept_back is None else kept_back.fit_percent,
                misfit=alone.misfit,
                validation_misfit=own.validation_misfit,
                predicted_misfit=None if predicted is None else predicted.predicted_misfit,
                ranking=ranking,
                model=own.fit.model,
                moved=moved(steps[-1].model, own.fit.model, standard_errors(own.fit)) if steps else (),
                added=added[0].name if added else None,
            )
        )
    return steps
