"""What to measure next, by what a verdict leaves open."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ambid.diagnosis.evidence import DISTINCT
from ambid.diagnosis.messages import place
from ambid.diagnosis.result import Step
from ambid.diagnosis.verdict import Verdict
from ambid.findings import NOWHERE, Finding, Kind

TWINS = 0.999
"""Effects whose freed responses have a larger cosine are the same in this kind of record."""
WITH_VALIDATION = Kind(
    "next_diagnose_validation",
    "note",
    "diagnose the records to validate on together with these, to see what is missing there",
)
LOWER_TOLERANCE = Kind(
    "next_lower_tolerance",
    "note",
    "nothing, if that is good enough; else look for what is left with a tolerance of {tolerance:.2f}",
)
LARGER_AMPLITUDE = Kind(
    "next_larger_amplitude",
    "note",
    "nothing is needed in this band and at this amplitude; a larger one would show nonlinear effects",
)
WHAT_CHANGES = Kind(
    "next_find_what_changes",
    "note",
    "look for what changes {parameter} from one operating point to the next, such as a coil that warms, or a reading "
    "whose scale depends on the current; or diagnose each point by itself",
)
WHAT_REMAINS = Kind(
    "next_judge_residual",
    "note",
    "the residual is largest in {channel} from {low_hz:.4g} to {high_hz:.4g} Hz ({cell_misfit:.1f} times noise): state "
    "the tolerance that is good enough[, or record at {amplitude_factor:g} times the amplitude, where formulas of "
    "large motion matter less, and diagnose the records together]",
)
NOTHING = Kind(
    "next_nothing", "note", "nothing is needed: one model is consistent with the records of all these operating points"
)
OTHER_POINT = Kind(
    "next_other_point",
    "note",
    "nothing is needed here; another bias current or speed would show whether the effect follows it",
)
VALIDATE = Kind("next_validate_explanation", "note", "validate on a record at another amplitude or bias current")
WARM = Kind(
    "next_repeat_warm",
    "note",
    "repeat when the machine is warm and its supplies have settled, and record temperature and bias current",
)
UNEXCITED = Kind(
    "next_record_unexcited", "note", "record without excitation and look for what goes on at {frequency_hz:.2f} Hz"
)
AMPLITUDES = Kind(
    "next_other_amplitudes",
    "note",
    "the misfit is largest in {channel} from {low_hz:.4g} to {high_hz:.4g} Hz: repeat at half and twice the amplitude "
    "and diagnose the records together, to see how it grows",
)
AT_EVERY_AMPLITUDE = Kind(
    "next_measure_shape",
    "note",
    "the misfit is largest in {channel} from {low_hz:.4g} to {high_hz:.4g} Hz, of records at several amplitudes: "
    "measure the shape of what a port needs, or record at another bias current or speed, "
    "and diagnose the records together",
)
MORE_PERIODS = Kind(
    "next_more_periods",
    "note",
    "to distinguish {effects}: {periods_factor:.1f} times as many periods, or {amplitude_factor:.1f} times the "
    "amplitude; or another bias current, speed or controller gain, diagnosed together with this record",
)
OTHER_EXPERIMENT = Kind(
    "next_other_experiment",
    "note",
    "to distinguish {effects}: more periods alone would hardly do, since they are all but the same in such a record: "
    "record i_c if it is missing, or measure at another bias current, speed or controller gain, and diagnose the "
    "records together",
)
ANY_EXPERIMENT = Kind(
    "next_any_experiment",
    "note",
    "to distinguish {effects}: measure at another amplitude, bias current or controller gain",
)
SIMULATE = Kind(
    "next_simulate_experiments",
    "note",
    "a simulation of such experiments finds the cheapest, and how long to record",
)


def next_steps(verdict: Verdict, history: Sequence[Step]) -> tuple[Finding, ...]:
    """What to do next, the first thing first.

    Parameters
    ----------
    verdict : Verdict
    history : sequence of Step
        With the ranking before each step.
    """
    if verdict.word == "ambiguous":
        return (*(_distinguish(names, history) for names in verdict.sets), SIMULATE(NOWHERE))
    if verdict.shows_elsewhere:
        return (WITH_VALIDATION(NOWHERE),)
    if verdict.is_only_good_enough:
        return (LOWER_TOLERANCE(NOWHERE, tolerance=verdict.fit.by_chance),)
    if verdict.word == "adequate":
        return (LARGER_AMPLITUDE(NOWHERE),)
    if verdict.word == "explained" and verdict.changes:
        return (WHAT_CHANGES(NOWHERE, parameter=verdict.changes[0].parameter),)
    if verdict.remains is not None and not verdict.is_to_the_noise:
        factor = None if verdict.others == "amplitudes" else 0.5
        return (WHAT_REMAINS(NOWHERE, amplitude_factor=factor, **place(verdict.remains)),)
    if verdict.word == "explained":
        return (({"operating points": NOTHING, "amplitudes": OTHER_POINT}.get(verdict.others, VALIDATE))(NOWHERE),)
    cell = verdict.where.cells[0]
    if cell.kind == "drift":
        return (WARM(NOWHERE),)
    if cell.kind == "synchronous":
        return (UNEXCITED(NOWHERE, frequency_hz=float(np.mean(cell.band_hz))),)
    return ((AT_EVERY_AMPLITUDE if verdict.others == "amplitudes" else AMPLITUDES)(NOWHERE, **place(cell)),)


def _distinguish(names: Sequence[str], history: Sequence[Step]) -> Finding:
    """Periods that would do, by the evidence S (1 - rho^2) of the score for the difference.

    Of one effect against nothing it is S, beside all others; of several, where the first of them is missed most.
    """
    effects = [*names, "nothing"] if len(names) == 1 else list(names)
    for step in history[::-1] if len(names) == 1 else history:
        first, *others = (step.ranking.find(name) for name in names)
        if first is None or None in others:
            continue
        apart = [first.evidence_against(other) for other in others if other is not None]
        evidence = min(apart, default=first.score)
        if evidence > first.score * (1.0 - TWINS**2):
            factor = max(1.0, DISTINCT / max(evidence, 1e-9))
            own: dict[str, Any] = {"periods_factor": factor, "amplitude_factor": float(np.sqrt(factor))}
            return MORE_PERIODS(NOWHERE, effects=effects, **own)
        return OTHER_EXPERIMENT(NOWHERE, effects=effects)
    return ANY_EXPERIMENT(NOWHERE, effects=effects)
