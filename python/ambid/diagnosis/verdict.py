"""What a search came to: one of five verdicts, read off the probabilities, with the facts that it rests on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.confirmation import Changing, changing, is_everywhere
from ambid.diagnosis.drift import Change, changes_of, largest_change
from ambid.diagnosis.evidence import OF_FORMULAS, SHAPE_OF_FORMULAS, SURE
from ambid.diagnosis.hypotheses import Field, Hypothesis, Names
from ambid.diagnosis.localisation import Cell, Localisation, largest_cell, localise
from ambid.diagnosis.nameless import Shown
from ambid.diagnosis.probabilities import Probabilities, probabilities
from ambid.diagnosis.task import Task
from ambid.findings import Where
from ambid.identification.covariance import covariance
from ambid.noise import Adequacy, Comparison, Criterion
from ambid.noise.adequacy import misfit_criterion
from ambid.noise.chance import RARE
from ambid.noise.tones import BESIDE
from ambid.noise.unseen import shape_left
from ambid.noise.wave import OUTSTANDING
from ambid.record import Measurement

CREDIBLE = 0.95
"""Probability of the sets, together, that are reported where no set is sure."""
LIKELY = 0.5
"""Probability from which on something else is taken for granted."""
EXCLUDED = 40.0
"""Log of the odds that a test has against noise alone whose chance is past all counting."""
OTHER_AMPLITUDE = 0.2
"""Relative difference of the excitation's rms that makes it another amplitude."""


@dataclass(frozen=True)
class Verdict:
    """The facts of a verdict.

    Attributes
    ----------
    word : str
        One of `result.VERDICTS`.
    probabilities : Probabilities
    effects : tuple of str
        That explain the misfit, in order.
    sets : tuple of tuple of str
        Effects that these data cannot distinguish.
    fit : Comparison
        Of the last model; of the base model where nothing is explained.
    where : Localisation
        Of the base model.
    misfit : float
        J/dof of the best set that was tried.
    tolerance : float
        Misfit up to which a model is good enough.
    share : float
        Part of the excess misfit of the base model that is explained, 0 to 1.
    change : Change or None
        Parameter that changes in what is left.
    tried : tuple of str
        Effects of the best set that was tried where none explains.
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
    left : Adequacy
        Of the best set that was tried, with lines, drift, shape and the records to validate on.
    adequacy : Adequacy
        The same of the last model.
    """

    word: str
    probabilities: Probabilities
    effects: tuple[str, ...]
    sets: tuple[tuple[str, ...], ...]
    fit: Comparison
    where: Localisation
    misfit: float
    tolerance: float
    share: float
    change: Change | None
    tried: tuple[str, ...]
    tried_share: float
    others: str
    is_stopped: bool
    is_chosen: bool
    changes: tuple[Changing, ...]
    remains: Cell | None
    left: Adequacy
    adequacy: Adequacy

    @property
    def louder(self) -> Criterion | None:
        """What the last model leaves above the noise and above what is good enough, though no misfit shows it."""
        failed = self.fit.adequacy.failed("power", "motion")
        return next((own for own in failed if own.statistic > self.tolerance), None)

    @property
    def is_to_the_noise(self) -> bool:
        """Whether the last model leaves no more than chance, or than is good enough, leaves."""
        return self.misfit <= max(self.tolerance, self.fit.bound) and self.louder is None

    @property
    def shows_elsewhere(self) -> bool:
        """Whether records to validate on show what those that the model was fitted to do not."""
        is_named = self.word != "none_of_the_candidates"
        return bool(self.left.failed("validation")) and (is_named or self.is_to_the_noise)

    @property
    def is_only_good_enough(self) -> bool:
        """Whether it is called adequate while more than chance is left."""
        return self.word == "adequate" and self.fit.by_chance < self.misfit <= self.tolerance


def judged(
    task: Task, field: Field, tolerance: float | None, *, is_stopped: bool = False, chosen: Hypothesis | None = None
) -> Verdict:
    """The verdict on all sets that were tried.

    Parameters
    ----------
    task : Task
    field : Field
    tolerance : float or None
        Misfit J/dof up to which a model is good enough for a person, whatever the records show to be missing.
    is_stopped : bool
        Whether a person ended the search before its end.
    chosen : Hypothesis, optional
        The set that a person has chosen.
    """
    best = chosen or field.best
    base, where = field.base.fit, localise(field.base.fit)
    changed, left = _left(field, best, where)
    of, against, local = best.fit, _against(best, left), frozenset[str]()
    if best.added and not task.validate and base.adequacy.is_within and not is_everywhere(base, best.fit):
        local = best.names
    score = max((own.values["score"] for own in left.failed("shape")), default=0.0)
    clean = _clean(field, best, where) if against else None
    found = probabilities(field, against, local, score, sum(own.odds for own in changed), clean)
    if local:
        best = field.base
    change = largest_change(changed)
    changes: tuple[Changing, ...] = ()
    is_noise = left.is_within and found.something_else < LIKELY
    if best.added and not is_noise and not is_stopped and not against:
        changes = changing(best.fit)
    enough = best.fit.by_chance if tolerance is None else tolerance
    is_small = best.fit.misfit <= max(enough, best.fit.by_chance)
    is_small &= all(own.statistic <= enough for own in left.failed("power", "motion"))
    is_good = tolerance is not None and not best.added and is_small and not against
    is_good &= all(own.statistic <= enough for own in left.failed("validation"))
    is_nameless = found.something_else > LIKELY and not changes
    word = "adequate" if is_good else _word(found, best, is_nameless=is_nameless, is_chosen=chosen is not None)
    if is_stopped and word in ("adequate", "none_of_the_candidates") and not (word == "adequate" and is_small):
        word = "not_informative"
    effects, fit = best.effects, best.fit
    sets: tuple[tuple[str, ...], ...] = ()
    tried: tuple[str, ...] = ()
    if word == "ambiguous":
        sets = _indistinguishable(found, effects)
    elif word == "adequate" and chosen is None:
        effects, fit = (), base
    elif word == "none_of_the_candidates" and chosen is None:
        tried, effects, fit = effects, (), base
    share = field.share_of_motion(best) if field.root else share_explained(base, best.fit)
    return Verdict(
        word,
        found,
        effects,
        sets,
        fit,
        where,
        best.fit.misfit,
        enough,
        share,
        change,
        tried,
        share if tried else 0.0,
        _others(task, base),
        is_stopped,
        chosen is not None,
        changes,
        largest_cell(fit, best.fit.renewed(), change) if word == "explained" else None,
        left,
        left if fit is of else _left(field, field.base, where)[1],
    )


def _word(found: Probabilities, best: Hypothesis, *, is_nameless: bool, is_chosen: bool) -> str:
    """The verdict where more than noise is left by the base model, or more is likely than nothing."""
    if is_nameless:
        return "none_of_the_candidates"
    if found.named < SURE * (found.named + found.nothing) and not is_chosen:
        return "adequate"
    if not best.added:
        return "none_of_the_candidates"
    is_sure = all(found.effects[name] > SURE * found.named for name in best.effects)
    return "explained" if is_chosen or is_sure else "ambiguous"


def _clean(field: Field, best: Hypothesis, where: Localisation) -> Names | None:
    """The set that comes nearest to noise, where it holds the best one and leaves nothing to tests other than J."""
    nearest = max(field.tried.values(), key=lambda own: field.alone(own.evidence))
    is_clean = nearest.names > best.names and not _against(nearest, _left(field, nearest, where)[1])
    return nearest.names if is_clean else None


def _against(own: Hypothesis, left: Adequacy) -> float:
    """Log of the odds against noise alone, or what formulas leave, in what a set leaves; a line is of neither."""
    return EXCLUDED if left.failed("line", "drift", "shape", *(() if own.added else ("power", "motion"))) else 0.0


def _left(field: Field, own: Hypothesis, where: Localisation) -> tuple[list[Change], Adequacy]:
    """What a set leaves: changes of parameters, one in each record, and all tests of a diagnosis."""
    fit, made, changes = own.fit, own.fit.adequacy, list(where.changes)
    if own.added:  # formulas may leave some of a shape
        fit = fit.renewed()
        made = Adequacy().beside(*(test for test in made.tests if test.name != "shape"), *_shapes_left(field, own))
        changes = changes_of(fit)
    if own.kept_back is not None:
        changes += changes_of(own.kept_back.renewed())
    beyond_chance = (each.criterion for each in changes if each.criterion.fails)
    return changes, made.beside(*_lines(fit), *beyond_chance, *_validation(own), *_ways(field.shown_by(own)))


def _ways(shown: Shown) -> Iterator[Criterion]:
    """What is left in the ways of effects, of which J over all lines sees little."""
    if shown.ways:
        yield Criterion("ways", shown.power / shown.ways, shown.ways, values={"ways": shown.ways})


def _shapes_left(field: Field, best: Hypothesis) -> Iterator[Criterion]:
    """The nonlinear shapes that a set leaves of the records beyond what formulas may leave.

    Linear effects can take the place of friction, of a dead band or of a stop at one amplitude, and leave little more
    than noise in all. A score for one shape sees less than the sum over all lines does.
    """
    if field.is_of_formulas(best) and best.evidence.beyond > 0.0:
        return
    fall = field.fall_by_physics(best)
    for part in best.fit.noise.in_time:
        share = OF_FORMULAS if part.noise_is_measured else SHAPE_OF_FORMULAS
        if own := shape_left(part, best.fit.model, max(share * fall, field.of_formulas(best.evidence))):
            yield own


def _lines(fit: Comparison) -> Iterator[Criterion]:
    """The tones of each record, of all its lines and channels, each over the lines beside it."""
    for part in fit.noise.in_time:
        channels, trials = part.record.channels, 0.5 * part.window.samples * len(part.record.channels)
        for tone in part.tones:
            at = Where(record=part.record.name, channel=channels[tone.channel])
            own = {"frequency_hz": tone.frequency_hz}
            yield Criterion("line", tone.power, 2.0, 2.0 * BESIDE.sum(), trials, OUTSTANDING, where=at, values=own)


def _indistinguishable(found: Probabilities, effects: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Of each effect of the best set, what stands in its place in other sets that are credible."""
    total, credible = 0.0, []
    for own in found.sets:
        credible.append(own.effects)
        total += own.total
        if total > CREDIBLE:
            break
    groups = []
    for name in effects:
        others = [n for own in credible if name not in own for n in own if n not in effects]
        if others:
            groups.append((name, *dict.fromkeys(others)))
    further = [n for own in credible if set(effects) < set(own) for n in own if n not in effects]
    if not groups and further:
        groups = [tuple(dict.fromkeys(further))]
    return tuple(groups)


def share_explained(base: Comparison, fit: Comparison) -> float:
    """Part of the excess misfit of the base model that another fit explains, in the same noise, 0 to 1."""
    excess = base.cost - base.dof
    return 1.0 if excess <= 0.0 else min(1.0, max(0.0, (base.cost - fit.cost) / excess))


def _validation(best: Hypothesis) -> Iterator[Criterion]:
    """Misfit of the records to validate on against their bound, and what errors of the fit bring to it.

    The parameters' covariance C of the fit makes the J of a record with the Hessian H larger by tr(C H) on average:
    the larger, the more a record shows that was kept back. It is bounded as chi-squared with that mean and the variance
    2 tr(C H C H) (Satterthwaite).
    """
    misfit, kept_back = best.validation_misfit, best.kept_back
    if misfit is None or kept_back is None:
        return
    least = kept_back.bound
    if misfit > least:
        free = range(len(kept_back.model.names))
        carried = covariance(best.fit, free) @ kept_back.noise.quadratic(kept_back.model, free).hessian
        mean, square = float(np.trace(carried)), float(np.trace(carried @ carried))
        least += square / mean * float(chdtri(mean**2 / square, RARE)) / kept_back.dof
    yield replace(misfit_criterion(misfit, kept_back.dof, kept_back.noise.scatter), name="validation", least=least)


def _others(task: Task, base: Comparison) -> str:
    """What the model was held against beside one amplitude at one operating point."""
    if base.model.points:
        return "operating points"
    own, other = _amplitudes(base.noise.records), _amplitudes(task.validate)
    differ = bool(own) and max(own) > (1.0 + OTHER_AMPLITUDE) * min(own)
    validated = bool(own) and any(all(abs(a / b - 1.0) > OTHER_AMPLITUDE for b in own) for a in other)
    return "amplitudes" if validated or differ else ""


def _amplitudes(records: Sequence[Measurement]) -> list[float]:
    """Rms of what drives each record in time; a frequency response gives none."""
    return [record.amplitude for record in records if record.is_in_time]
