"""Name the missing effect: check that the data suffice, fit the base model, search, and report what was found."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ambid.checking import (
    CURRENT_AHEAD,
    CURRENT_BEHIND,
    FORCE_TOO_SMALL,
    OPERATING_POINT_DRIFT,
    check,
    stops_diagnosis,
)
from ambid.diagnosis.advice import next_steps
from ambid.diagnosis.families import families
from ambid.diagnosis.hypotheses import Field, Hypothesis, begun
from ambid.diagnosis.ledger import steps_to
from ambid.diagnosis.messages import findings_of, not_determined
from ambid.diagnosis.ranking import Progress, rank, silent
from ambid.diagnosis.refits import added, ended, nominal_beside, refined
from ambid.diagnosis.result import Diagnosis
from ambid.diagnosis.search import Ask, asked, explored
from ambid.diagnosis.standing import BASE_UNSTABLE, base_unstable, choice_unstable, holders, nothing_holds, standing
from ambid.diagnosis.task import Task
from ambid.diagnosis.verdict import Verdict, judged
from ambid.effects import CATALOGUE, Effect, find
from ambid.errors import ModelError, RigError, Stopped, UnstableLoopError, UnstableStartError
from ambid.findings import NOWHERE, Finding, Kind, has
from ambid.identification import Estimate, ParameterEstimate, identify
from ambid.identification.covariance import budget, covariance
from ambid.identification.identifiability import lost, only_frequency, weakest
from ambid.identification.minimum import refit
from ambid.identification.tolerances import NOISE, budget_by_name, known_values
from ambid.identification.tolerances import findings_of as findings_of_tolerances
from ambid.model import Given, Model, as_model
from ambid.model.parameter import nominal
from ambid.noise import Comparison, compare
from ambid.noise.compared import averaged_over
from ambid.record import Measurement, Source, measured
from ambid.record.measurement import findings_of_repeats, findings_of_validation
from ambid.threads import with_one_blas_thread

UNDRIVEN = Kind(
    "records_not_driven",
    "warning",
    "nothing drives the records, and a free response does not show which physics is missing",
    "excite the loop",
)


@with_one_blas_thread
def diagnose(
    model: Given,
    records: Source | Sequence[Source],
    *,
    validate: Source | Sequence[Source] = (),
    effects: Sequence[str | Effect] | None = None,
    catalogue: Sequence[Effect] = CATALOGUE,
    tolerance: float | None = None,
    prior: Mapping[str, float] | None = None,
    ask: Ask | None = None,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress = silent,
) -> Diagnosis:
    """Compare, name the missing effect, add it, refit, until nothing more is supported by the data.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        Start; a rig means its nominal values.
    records : Record or FrequencyResponse, path of a file, or sequence of them
        Records of two or more periods each (four for tones and drift), or with an excitation that never repeats; at any
        amplitudes, and at any operating points (`Record.at`).
    validate : likewise
        Not used for choosing; best at another amplitude.
    effects : sequence of str or Effect, optional
        A person's own choice: add these, names of the catalogue or effects, in this order, instead of choosing. An
        effect keeps the settings that it is given with, such as its place.
    catalogue : sequence of Effect
        Candidates; effects of your own may be among them.
    tolerance : float, optional
        Misfit J/dof up to which a model is good enough for you, whatever the records show to be missing; by default
        what they show decides.
    prior : mapping of str to float, optional
        Probability of effects by name before any record; by default all of the catalogue are alike.
    ask : callable, optional
        Shown the ranking and the candidate that is to be added; False ends the search, and another candidate of the
        ranking is added in its place.
    say : callable
        Told about every step.
    progress : callable
        Told what is being done within a step, how much of it is done, and how much there is.

    Returns
    -------
    Diagnosis

    Notes
    -----
    Ctrl-C passes on as a KeyboardInterrupt; from the first step on it is `Stopped`, which holds the diagnosis so far.

    Raises
    ------
    ModelError
        If an effect of `effects` is unknown, or cannot be added to this model.
    RecordError
        If a record has no excitation.
    UnstableLoopError
        If the base model has no stable start.
    """
    begun_at = time.perf_counter()
    chosen = None
    if effects is not None:
        chosen = [find(effect, catalogue=catalogue) if isinstance(effect, str) else effect for effect in effects]
    start = as_model(model).with_tolerances()
    records, validate = measured(records, start.rig), measured(validate, start.rig)
    start = start.covering(records)
    for record in validate:
        start.at(record)  # refuses one at a bias current that no other record has
    try:
        rig = start.to_rig()
    except RigError:  # a fit has driven its values beyond what a rig file may hold
        rig = start.rig
    in_time = [record for record in (*records, *validate) if record.is_in_time and record.y.size]
    findings = check(rig, in_time).findings
    stops = [finding for finding in findings if stops_diagnosis(finding)]
    if stops:
        return Diagnosis.uninformative(start, records, stops, begun_at)
    estimate, bases = _base(start, records)
    if estimate is not None and (why := list(_uninformed(start, estimate))):
        return Diagnosis.uninformative(estimate.model, records, why, begun_at)
    task = Task(
        nominal=_nominal(start),
        validate=tuple(validate),
        catalogue=tuple(catalogue),
        progress=progress,
        as_given=tuple(effect for effect in chosen or () if effect.settings()),
        given_prior=dict(prior or {}),
    )
    if not bases:
        bases = standing(start, records, catalogue if chosen is None else chosen)
        if not bases and chosen:
            others = holders(start, catalogue, records)
            raise ModelError(choice_unstable(start, chosen, others).line())
        if not bases:
            return Diagnosis.uninformative(start, records, [nothing_holds(start)], begun_at)
        findings = (*findings, base_unstable(start, bases))
    elif not bases[0].is_adequate and not all(part.noise_is_measured for part in bases[0].noise.parts):
        bases = [refit(bases[0])]  # `identify` did not trust the weights, as physics is missing
    field = begun(task, *bases)

    def concluded(*, is_stopped: bool) -> Diagnosis:
        own = (
            field
            if is_stopped or not (chosen or field.is_explained)
            else ended(field, (of_choice(field) or field.best).names)
        )
        end = of_choice(own)
        verdict = judged(task, own, tolerance, is_stopped=is_stopped, chosen=end)
        return _diagnosis(verdict, own, end or own.best, bases[0], task, records, start, findings, begun_at)

    def of_choice(field: Field) -> Hypothesis | None:
        return None if chosen is None else max(field.tried.values(), key=lambda own: len(own.added))

    try:
        say(_line(field.base, field.base))
        ways = _chosen(task, field, chosen) if chosen is not None else None
        for further in ways or (explored(task, field) if ask is None else asked(task, field, ask)):
            before, field = field.foremost, further
            if field.foremost.names != before.names:
                say(_line(field.foremost, field.base))
        return concluded(is_stopped=False)
    except KeyboardInterrupt:
        pass  # what is reported of the sets that were tried is no part of the stack that was interrupted
    raise Stopped(concluded(is_stopped=True))


def _base(start: Model, records: tuple[Measurement, ...]) -> tuple[Estimate | None, list[Comparison]]:
    """The estimate of the base model and its comparison; none of an unstable one."""
    try:
        estimate = identify(start, records)
    except UnstableStartError:
        return None, []
    except UnstableLoopError:  # driven to the edge of stability by records that no such loop has made
        return None, [compare(start, records)]
    return estimate, [estimate.comparison]


def _chosen(task: Task, field: Field, effects: Sequence[Effect]) -> Iterator[Field]:
    """Add a person's own choice, in this order.

    Raises
    ------
    ModelError
        If an effect cannot be judged on this model, or makes no stable loop.
    """
    names = field.root
    for k, effect in enumerate(effects):
        if effect.name in field.root:
            continue
        fit = field.tried[names].fit
        try:
            ranking = rank(fit, [effect], start=nominal_beside(task, fit.model))
            if not ranking.candidates:
                why, earlier = ranking.not_tried.get(effect.name), ", ".join(own.name for own in effects[:k])
                remedy = f"; choose it before {earlier}" if why and earlier else ""
                why = why or "it is in the model already"
                raise ModelError(f"{effect.name} cannot be added to this model ({why}){remedy}")
            field = refined(task, added(task, field, names, ranking.candidates[0]), names | {effect.name})
            names = names | {effect.name}
            own = field.tried[names]
            for one in (own.fit, own.kept_back):
                if one is not None:
                    one.fit_percent  # noqa: B018  refuses a response that leaves all bounds
        except UnstableLoopError as error:
            raise ModelError(
                f"{effect.name} cannot be added to this model: with it the response to "
                f"{_leaving(field, names, effect)} leaves all bounds ({error}); leave the effect out, give it settings "
                "of its own, or leave this record out"
            ) from None
        yield field


def _leaving(field: Field, names: frozenset[str], effect: Effect) -> str:
    """The records whose response leaves all bounds with an effect; all of them where none is known to."""
    own = field.tried[names]
    model = own.fit.model if effect.name in names else own.fit.model.add(effect)
    parts = [part for one in (own.fit, own.kept_back) if one is not None for part in one.noise.parts]
    found = []
    for part in parts:
        try:
            part.departure(part.at(model))
        except UnstableLoopError:
            found.append(part.record.name)
    return ", ".join(found or [part.record.name for part in parts])


def _line(own: Hypothesis, base: Hypothesis) -> str:
    """A set that was tried, in a line of text."""
    names = " + ".join(own.effects) or "base model"
    percent = own.fit.fit_percent
    text = f"{names:36s} misfit {own.fit.misfit:10.3f}   fit of {averaged_over(percent)} {percent['average']:6.2f} %"
    if own.validation_misfit is not None and own.kept_back is not None:
        text += f"   validation {own.validation_misfit:.3f}, {own.kept_back.fit_percent['average']:.2f} %"
    return text


def _diagnosis(
    verdict: Verdict,
    field: Field,
    best: Hypothesis,
    base: Comparison,
    task: Task,
    records: tuple[Measurement, ...],
    start: Model,
    findings: Sequence[Finding],
    begun_at: float,
) -> Diagnosis:
    """What a search has found, with the words for it."""
    every = range(len(verdict.fit.model.names))
    spread = covariance(verdict.fit, every)
    model = verdict.fit.model.with_substeps(None).with_covariance(spread)
    tolerances = known_values(model, spread, every)
    variances = budget_by_name(model.names, tolerances, budget(verdict.fit, every)) if tolerances else {}
    history = steps_to(task, field, best, base)
    near = families(field, best)
    unnamed = verdict.word == "none_of_the_candidates"
    slips = [finding for finding in findings if unnamed and _is_slip(finding)]
    return Diagnosis(
        verdict=verdict.word,
        effects=verdict.effects,
        ambiguous_sets=[list(names) for names in verdict.sets],
        probabilities=verdict.probabilities,
        history=history,
        localisation=verdict.where,
        model=model,
        fit=verdict.fit,
        kept_back=best.kept_back,
        parameters={
            p.name: ParameterEstimate.of(
                p, float(error), float(np.sqrt(variances[p.name][NOISE])) if tolerances else None
            )
            for p, error in zip(model.parameters, np.sqrt(np.diag(spread)), strict=True)
            if p.prior is None
        },
        tolerances=tolerances,
        variances=variances,
        covariance=spread,
        explained_percent=100.0 * verdict.share if verdict.effects or verdict.tried else np.nan,
        families={name: near[name] for name in verdict.effects if name in near},
        records=records,
        validation=task.validate,
        next_steps=tuple(slips[:1]) or next_steps(verdict, history),
        seconds=time.perf_counter() - begun_at,
        adequacy=verdict.adequacy,
        findings=(
            *findings_of_repeats(records),
            *findings_of_validation(records, task.validate),
            *_undetermined(start, verdict.fit),
            *findings_of(verdict, verdict.fit.noise, history),
            *findings_of_tolerances(start.rig, tolerances),
            *(finding for finding in findings if has([finding], BASE_UNSTABLE, OPERATING_POINT_DRIFT, FORCE_TOO_SMALL)),
            *slips,
            *(finding for finding in findings if unnamed and has([finding], CURRENT_BEHIND)),
        ),
    )


def _is_slip(finding: Finding) -> bool:
    """Whether it is to be set right first where no hypothesis explains the records."""
    return finding.severity == "error" or has([finding], CURRENT_AHEAD)


def _nominal(start: Model) -> Model:
    """The start with the values of its rig file, if they make a stable loop: a fit before may have been driven off."""
    own = {p.name: p.value for p in nominal(start.rig) if p.name in start.names}
    stated = start.with_values(own)
    return stated if stated.is_stable else start


def _uninformed(start: Model, estimate: Estimate) -> Iterator[Finding]:
    """Why the records cannot determine what is missing, with the misfit, if there is one; nothing where they can."""
    comparison, names = estimate.comparison, start.free
    frequency = only_frequency(comparison, names) if comparison.is_judged else None
    if estimate.inconsistency is None:
        yield from not_determined(estimate.directions, frequency) if estimate.directions else ()
    elif all(record.is_free_response for record in estimate.records):
        yield from (estimate.inconsistency, UNDRIVEN(NOWHERE))
    elif frequency is not None or len(estimate.directions) == len(names):
        directions = estimate.directions or (weakest(comparison.of(start), names) if start.is_stable else [])
        yield from (estimate.inconsistency, *not_determined(directions, frequency))


def _undetermined(start: Model, fit: Comparison) -> Iterator[Finding]:
    """What of the base model the records do not determine, beside whatever was found.

    Misfit that is left may have driven the parameters where nothing is determined: then it is asked where they began.
    """
    directions = lost(fit, fit.model.free)
    if directions and not fit.is_adequate and start.is_stable:
        directions = lost(fit.of(start), start.free)
    own = [direction for direction in directions if not direction.keys().isdisjoint(start.names)]
    yield from not_determined(own)
