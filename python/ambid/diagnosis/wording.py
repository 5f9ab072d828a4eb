"""What a diagnosis says in words: notes on its verdict, and the cheapest experiment that would tell the rest apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ambid.diagnosis.result import GOOD_ENOUGH, IN_THE_MAIN, Step
from ambid.diagnosis.rivals import ENOUGH
from ambid.diagnosis.verdict import Verdict
from ambid.effects.disturbance import PeriodicDisturbance
from ambid.effects.slips import ControllerGainError, ExcitationGainError
from ambid.noise import Noise
from ambid.noise.response_lines import ResponseLines
from ambid.results import band_text, told_apart
from ambid.rig import PidController, Rig

__all__ = ["next_experiment", "notes", "not_determined"]

TWINS = 0.999
"""Effects whose freed responses have a larger cosine are the same in this kind of record."""
CONTROLLER_SLIP, EXCITATION_SLIP = ControllerGainError.name, ExcitationGainError.name
HUM = PeriodicDisturbance.name
MINOR = 0.05
"""Gains whose error is a smaller part of the largest one are not told."""
OF_SMALL_MOTION = (
    "a frequency response, which is of small motion and repeats: nonlinear effects, disturbances, tones and drift were "
    "not looked for in it"
)
FORESEEN = "`ambid diagnose --next` simulates these and tells which is the cheapest, and how long to record"
WITHOUT_PERIODS = (
    "i_e does not repeat, or not often enough to see it: the noise is what no smooth response to i_e explains, and "
    "drift was not looked for"
)


def not_determined(directions: Sequence[Mapping[str, float]], frequency_hz: float | None = None) -> str:
    """Which changes of the parameters the records do not tell, and what would.

    Parameters
    ----------
    directions : sequence of mapping of str to float
        Relative changes by parameter.
    frequency_hz : float, optional
        The only one that is excited.
    """
    told = []
    for direction in directions:
        parts = [f"{name} by {share:+.2g} %" for name, share in direction.items()]
        told.append(f"a change of {' with '.join(parts)}")
    what = f"the records do not determine {', nor '.join(told)}" if told else ""
    if frequency_hz is None:
        return f"{what}; excite every axis, with more amplitude or for longer"
    only = (
        f"all excitation is at {frequency_hz:.4g} Hz, where each channel gives two numbers, whatever the machine does"
    )
    return f"{f'{what}: ' if what else ''}{only}; excite at three frequencies or more, or by steps or noise"


def notes(verdict: Verdict, noise: Noise) -> Iterator[str]:
    """What a reader of a verdict must know beside it.

    Parameters
    ----------
    verdict : Verdict
    noise : Noise
        Of the records.
    """
    if verdict.word in ("explained", "ambiguous") and not verdict.is_to_the_noise:
        value, good = told_apart(verdict.fit.loudest, verdict.tolerance)
        left = f"{value} times the noise remains {verdict.fit.when_loudest}, above {good}"
        bound = max(verdict.tolerance, verdict.fit.bound)
        if verdict.misfit > bound:
            left = "J/dof {} remains, above its bound {}".format(*told_apart(verdict.misfit, bound))
        why = (
            "what is left stands out of the noise, since their formulas only approximate this machine or something "
            "smaller is missing"
        )
        if verdict.changes:
            why = (
                "at every operating point by itself they explain all of it, with other values of what all points share"
            )
        yield (
            f"{IN_THE_MAIN}: the effects explain {100 * verdict.share:.1f} % of the excess misfit, but {left}: {why}"
        )
        for own in verdict.changes:
            yield f"{own.parameter} changes with the operating point: from {' to '.join(own.ends)}"
    if verdict.is_only_good_enough:
        below, asked = told_apart(verdict.misfit, verdict.tolerance)
        above, chance = told_apart(verdict.misfit, verdict.fit.by_chance)
        cell = verdict.where.cells[0]
        yield (
            f"{GOOD_ENOUGH}: J/dof {max(below, above, key=len)} remains, within the {asked} that is asked for, but "
            f"above the {chance} that chance brings: something small is missing, most of it in {cell.channel} from "
            f"{band_text(*cell.band_hz, ' to ')} Hz ({cell.misfit:.1f} times noise)"
        )
    if verdict.is_chosen and verdict.word == "none_of_the_candidates":
        yield (
            f"chosen and kept: {', '.join(verdict.effects)}; the data do not confirm that this explains the misfit "
            f"(J/dof {verdict.misfit:.2f}, bound {verdict.fit.bound:.2f})"
        )
    yield from _slips(verdict)
    if verdict.word == "none_of_the_candidates":
        if verdict.tried:
            names, share = ", ".join(verdict.tried), 100 * verdict.tried_share
            yield f"best tried: {names}, which explains {share:.0f} % of the excess misfit; not added"
        if verdict.shape:
            left = "what that leaves" if verdict.tried else "what is left"
            yield f"{left} is no noise: {verdict.shape}, which nothing of the catalogue brings on all records"
        yield from (f"a tone at {tone.frequency_hz:.2f} Hz is left" for tone in verdict.tones)
        if sentence := verdict.where.sentence():
            yield sentence
    if (change := verdict.change) is not None:
        yield (
            f"{change.parameter} seems to change during {change.record}, by {100 * change.relative:.2g} % at "
            f"{change.frequency_hz:.3g} Hz ({change.power:.0f} in units of noise, 2 where nothing changes)"
        )
    if verdict.kept_back is not None and _shows_elsewhere(verdict):
        yield (
            f"on the records to validate on the misfit is {verdict.kept_back:.2f} (J/dof), above its bound: what is "
            "missing there shows less, or not at all, in the records that the model was fitted to"
        )
    for part in noise.parts:
        if isinstance(part, ResponseLines):
            yield f"{part.record.name}: {OF_SMALL_MOTION}"
        elif not part.window.is_periodic:
            yield f"{part.record.name}: {WITHOUT_PERIODS}"
    for held in verdict.fit.records:
        yield from (told for told in (held.uneven, "" if verdict.is_to_the_noise else held.louder) if told)
    yield from _of_one_axis(verdict)
    if verdict.is_stopped:
        yield "stopped by Ctrl-C after the steps above: more may be missing, and rivals were not compared"


def _shows_elsewhere(verdict: Verdict) -> bool:
    """Whether records to validate on show what those that the model was fitted to do not."""
    return verdict.word != "none_of_the_candidates" or verdict.is_to_the_noise


def _of_one_axis(verdict: Verdict) -> Iterator[str]:
    """That one axis does not tell where a hum comes in."""
    if len(verdict.fit.model.rig.axes) > 1:
        return
    for effect in verdict.fit.model.effects:
        if effect.name in verdict.effects and effect.name == HUM:
            yield (
                f"{HUM}: on one axis a force, a current and a hum of the sensor give the same record; hold the mass "
                "still and record y to tell the sensor's"
            )


def _slips(verdict: Verdict) -> Iterator[str]:
    """That the rig file or the record is wrong, in which key, and the value that the data ask for."""
    rivals = {name for names in verdict.sets for name in names} - set(verdict.effects)
    errors = {p.name: p.value for p in verdict.fit.model.parameters}
    for slip, wrong in ((CONTROLLER_SLIP, "the rig file"), (EXCITATION_SLIP, "i_e of the record")):
        own = {name.rpartition(".")[2]: e for name, e in errors.items() if name.startswith(f"{slip}.")}
        if slip in verdict.effects:
            least = MINOR * max(abs(e) for e in own.values())
            told = "; ".join(_asked_for(verdict.fit.model.rig, key, e) for key, e in own.items() if abs(e) >= least)
            yield f"{slip}: {wrong} is wrong, and not the physics of the model; {told}"
        elif slip in rivals:
            yield f"{slip}, which does as well, would mean that {wrong} is wrong, and not the physics of the model"


def _asked_for(rig: Rig, key: str, error: float) -> str:
    """A gain as the rig file or the record has it, and as the data ask for."""
    if key == "scale":
        return f"the data ask for {1.0 + error:.4g} times the i_e that was recorded"
    if not isinstance(rig.controller, PidController):
        return f"the data ask for {1.0 + error:.4g} times the [controller] in the rig file"
    gains = np.atleast_1d(getattr(rig.controller, key))
    found, wanted = (", ".join(f"{float(f'{gain:.4g}'):g}" for gain in own) for own in (gains, (1.0 + error) * gains))
    return f"controller.{key} = {found} in the rig file, the data say {wanted}"


def next_experiment(verdict: Verdict, history: Sequence[Step]) -> str:
    """What to measure next.

    Parameters
    ----------
    verdict : Verdict
    history : sequence of Step
        With the ranking before each step.
    """
    if verdict.kept_back is not None and verdict.word != "ambiguous" and _shows_elsewhere(verdict):
        return "diagnose the records to validate on together with these, to see what is missing there"
    if verdict.is_only_good_enough:
        return (
            f"nothing, if that is good enough; else look for what is left with --tolerance {verdict.fit.by_chance:.2f}"
        )
    if verdict.word == "adequate":
        return "nothing is needed in this band and at this amplitude; a larger one would show nonlinear effects"
    if verdict.word == "ambiguous":
        return "; ".join([*(_apart(names, history) for names in verdict.sets), FORESEEN])
    if verdict.word == "explained" and verdict.changes:
        return (
            f"look for what changes {verdict.changes[0].parameter} from one operating point to the next, such as a "
            "coil that warms, or a reading whose scale depends on the current; or diagnose each point by itself"
        )
    if verdict.remains is not None and not verdict.is_to_the_noise:
        cell = verdict.remains
        return (
            f"what is left is largest in {cell.channel} from {band_text(*cell.band_hz, ' to ')} Hz "
            f"({cell.misfit:.1f} times noise): state what is good enough with --tolerance, or record at half the "
            "amplitude, where formulas of large motion matter less, and diagnose the records together"
        )
    if verdict.word == "explained":
        if verdict.others == "operating points":
            return "nothing is needed: one model meets the records of all these operating points"
        if verdict.others:
            return "nothing is needed here; another bias current or speed would show whether the effect follows it"
        return "validate on a record at another amplitude or bias current"
    cell = verdict.where.cells[0]
    if cell.kind == "drift":
        return "repeat when the machine is warm and its supplies have settled, and record temperature and bias current"
    if cell.kind == "synchronous":
        return f"record without excitation and look for what goes on at {np.mean(cell.band_hz):.2f} Hz"
    return (
        f"the misfit is largest in {cell.channel} from {band_text(*cell.band_hz, ' to ')} Hz: repeat at "
        "half and twice the amplitude and diagnose the records together, to see how it grows"
    )


def _apart(names: Sequence[str], history: Sequence[Step]) -> str:
    """Periods that would do, by the evidence S (1 - rho^2) of the score for the difference."""
    for step in history:
        first, *others = (step.ranking.find(name) for name in names)
        if first is None or None in others:
            continue
        text = f"to tell {' from '.join(names)}: "
        evidence = min(first.evidence_against(other) for other in others if other is not None)
        if evidence > first.score * (1.0 - TWINS**2):
            factor = max(1.0, ENOUGH / max(evidence, 1e-9))
            return (
                f"{text}{factor:.1f} times as many periods, or {np.sqrt(factor):.1f} times the amplitude; or another "
                "bias current, speed or controller gain, diagnosed together with this record"
            )
        return (
            f"{text}more periods alone would hardly do, since they are all but the same in such a record: record i_c "
            "if it is missing, or measure at another bias current, speed or controller gain, and diagnose the records "
            "together"
        )
    return f"to tell {' from '.join(names)}: measure at another amplitude, bias current or controller gain"
