"""What a reader of a verdict must know beside it, as findings made from its facts."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ambid.diagnosis.localisation import Cell
from ambid.diagnosis.result import EXPLAINED_BY_POINT, GOOD_ENOUGH, MOSTLY_EXPLAINED, STOPPED, Step
from ambid.diagnosis.verdict import Verdict
from ambid.findings import NOWHERE, Finding, Kind, Where
from ambid.noise import Noise
from ambid.noise.adequacy import WHEN
from ambid.noise.halves import UNEVEN
from ambid.noise.unseen import LOUDER, OVER_CEILING

NOT_DETERMINED = Kind(
    "not_determined",
    "warning",
    "the records do not determine a change of {changes_percent:+.2g} %",
    "excite every axis, at more frequencies, with more amplitude or for longer",
)
SINGLE_FREQUENCY = Kind(
    "single_frequency",
    "warning",
    "all excitation is at {frequency_hz:.4g} Hz, where each channel gives two numbers, whatever the machine does",
    "excite at three frequencies or more, or by steps or noise",
)
CHANGING = Kind(
    "changes_with_operating_point",
    "warning",
    "{parameter} changes with the operating point: from {least:.4g} +- {least_ci95:.2g}[ {unit}] at {least_at} to "
    "{most:.4g} +- {most_ci95:.2g}[ {unit}] at {most_at}",
)
UNCONFIRMED = Kind(
    "choice_not_confirmed",
    "warning",
    "chosen and kept: {effects}; the data do not confirm that this explains the misfit ({misfit:.2f}, limit "
    "{limit:.2f}, J/dof)",
)
TRIED = Kind(
    "best_tried",
    "note",
    "best tried: {effects}, by which {explained:.0f|%} of the excess misfit is explained; not added",
)
SHAPE = Kind(
    "unexplained_nonlinear_residual",
    "warning",
    "what is left[ by {effects}] is no noise: it acts as a {port}, is {kind} and looks like {shape}, which "
    "nothing of the catalogue brings on all records",
)
WAYS = Kind(
    "residual_in_the_ways_of_effects",
    "warning",
    "what is left[ by {effects}] is no noise: it changes the response in {ways} ways, as effects do, with {ratio:.2f} "
    "times the power of noise, limit {limit:.2f}, and none of the catalogue explains it",
    "record with more amplitude or for longer, and at another amplitude",
)
LINE = Kind("residual_line", "note", "a line at {frequency_hz:.2f} Hz is left")
CHANGES = Kind(
    "parameter_seems_to_change",
    "warning",
    "{parameter} seems to change during the record, [by {change:.2g|%} at {frequency_hz:.3g} Hz][by {drift:.2g|%} from "
    "its begin to its end] ({power:.0f} times what noise brings)",
)
VALIDATION = Kind(
    "validation_above_limit",
    "warning",
    "the misfit on the records to validate on is {misfit:.2f} (J/dof), above its limit: what is missing there shows "
    "less, or not at all, in the records that the model was fitted to",
)
SMALL_MOTION = Kind(
    "response_of_small_motion",
    "note",
    "a frequency response is of small motion and repeats: nonlinear effects, disturbances, lines and drift were not "
    "searched for in it",
)
NO_PERIODS = Kind(
    "no_periods",
    "note",
    "i_e does not repeat, or not often enough to see it: the noise is what no smooth response to i_e explains, and "
    "drift was not searched for",
)


def not_determined(directions: Sequence[Mapping[str, float]], frequency_hz: float | None = None) -> Iterator[Finding]:
    """Which changes of the parameters the records do not determine, and why.

    Parameters
    ----------
    directions : sequence of mapping of str to float
        Relative changes by parameter [%].
    frequency_hz : float, optional
        The only one that is excited.
    """
    yield from (NOT_DETERMINED(NOWHERE, changes_percent=dict(direction)) for direction in directions)
    if frequency_hz is not None:
        yield SINGLE_FREQUENCY(NOWHERE, frequency_hz=frequency_hz)


def findings_of(verdict: Verdict, noise: Noise, history: Sequence[Step]) -> Iterator[Finding]:
    """What a reader of a verdict must know beside it.

    Parameters
    ----------
    verdict : Verdict
    noise : Noise
        Of the records.
    history : sequence of Step
        With the ranking before each step.
    """
    yield from _of_what_remains(verdict)
    yield from _of_effects(verdict, history)
    if verdict.word == "none_of_the_candidates":
        yield from _of_the_nameless(verdict)
    if (change := verdict.change) is not None:
        yield CHANGES(Where(record=change.record), **change.values, power=change.criterion.statistic)
    if verdict.shows_elsewhere:
        yield VALIDATION(NOWHERE, misfit=verdict.left.failed("validation")[0].statistic)
    for part in noise.parts:
        if not part.is_in_time:
            yield SMALL_MOTION(Where(record=part.record.name))
        elif not part.noise_is_measured:
            yield NO_PERIODS(Where(record=part.record.name))
    kinds = (UNEVEN,) if verdict.is_to_the_noise else (UNEVEN, LOUDER, OVER_CEILING)
    for record in verdict.fit.records:
        yield from (finding for finding in record.findings if finding.kind in kinds)
    if verdict.is_stopped:
        yield STOPPED(NOWHERE)


def place(cell: Cell) -> dict[str, Any]:
    """A cell of the misfit map as values of a finding."""
    low, high = cell.band_hz
    return {"channel": cell.channel, "low_hz": low, "high_hz": high, "cell_misfit": cell.misfit}


def _of_what_remains(verdict: Verdict) -> Iterator[Finding]:
    """That the effects that explain leave more than noise, or what is called adequate more than chance."""
    fit, limit = verdict.fit, max(verdict.tolerance, verdict.fit.bound)
    if verdict.word in ("explained", "ambiguous") and not verdict.is_to_the_noise:
        is_misfit = verdict.misfit > limit
        louder = None if is_misfit else verdict.louder
        yield (EXPLAINED_BY_POINT if verdict.changes else MOSTLY_EXPLAINED)(
            NOWHERE,
            explained=verdict.share,
            misfit=verdict.misfit if is_misfit else None,
            limit=limit if is_misfit else None,
            ratio=None if louder is None else louder.statistic,
            most=None if louder is None else max(louder.limit, verdict.tolerance),
            when=None if louder is None else WHEN[louder.name],
        )
        yield from (CHANGING(NOWHERE, **own.as_dict()) for own in verdict.changes)
    if verdict.is_only_good_enough:
        own: dict[str, Any] = {"misfit": verdict.misfit, "tolerance": verdict.tolerance, "by_chance": fit.by_chance}
        yield GOOD_ENOUGH(NOWHERE, **own, **place(verdict.where.cells[0]))
    if verdict.is_chosen and verdict.word == "none_of_the_candidates":
        yield UNCONFIRMED(NOWHERE, effects=list(verdict.effects), misfit=verdict.misfit, limit=fit.bound)


def _of_effects(verdict: Verdict, history: Sequence[Step]) -> Iterator[Finding]:
    """What the effects themselves say: those that are named, and those that explain the data as well."""
    model = verdict.fit.model
    for effect in model.effects:
        if effect.name in verdict.effects:
            own = {p.name: p.value for p in model.parameters if p.name.startswith(f"{effect.name}.")}
            yield from effect.findings(model.rig, {name.rpartition(".")[2]: value for name, value in own.items()})
    for name in sorted({name for names in verdict.sets for name in names} - set(verdict.effects)):
        found = (step.ranking.find(name) for step in history)
        if (rival := next((own for own in found if own is not None), None)) is not None:
            yield from rival.effect.findings(model.rig, None)


def _of_the_nameless(verdict: Verdict) -> Iterator[Finding]:
    """What is known of what has no name: what was tried, and where it acts."""
    tried = list(verdict.tried) or None
    if tried is not None:
        yield TRIED(NOWHERE, effects=tried, explained=verdict.tried_share)
    for shape in verdict.left.failed("shape")[:1]:
        yield SHAPE(NOWHERE, effects=tried, **shape.values)
    for left in verdict.left.failed("ways") if verdict.is_to_the_noise else ():
        yield WAYS(NOWHERE, effects=tried, ratio=left.statistic, limit=left.limit, **left.values)
    yield from (LINE(NOWHERE, **line.values) for line in verdict.left.failed("line"))
    yield from verdict.where.findings
