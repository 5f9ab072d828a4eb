"""Does an effect that is found where the base model is adequate stand elsewhere, too?

What is local in a record, such as a burst, a standstill or a wrong sample, can look like physics: but not on records
that were kept back, or, where there are none, on each half of those that it was found on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.rivals import Refitted
from ambid.diagnosis.state import State, Task
from ambid.errors import RecordError, UnstableLoopError
from ambid.identification.minimum import ROUGHLY, refit
from ambid.noise import Comparison
from ambid.noise.angles import undisturbed
from ambid.noise.tones import SUSPECTED
from ambid.record import FrequencyResponse, Measurement, Record

__all__ = ["CHANCE", "halves", "stands"]

CHANCE = 0.05
"""Chance of the fall of J that each piece of other evidence must show: what is just significant on a whole record shows
half of its score on each half, and passes 95 % where that score is 15."""
LEAST_PERIODS = 2
"""Periods of a half that is judged."""
LEAST_SAMPLES = 500
"""Samples of a half without periods that is judged."""
BESIDE = 4
"""Neighbouring frequencies of a response that stay together, since they may have an error in common: bands of a local
estimate."""
LEAST_FREQUENCIES = 16
"""Frequencies of a response whose halves are judged."""


def stands(task: Task, state: State, pair: Refitted) -> bool:
    """Whether other evidence shows the effect; where there is none, it is taken as it is.

    Parameters
    ----------
    task, state : Task, State
        The base model is adequate.
    pair : tuple of Candidate and Comparison
        What is to be added, and the refitted model.
    """
    candidate, better = pair
    if state.validation is not None:
        fall = state.validation.cost - state.validation.of(better.model).with_own_angles().cost
        return bool(fall > chdtri(candidate.degrees, CHANCE))
    is_wave = bool(candidate.effect.quarters(better.model.rig))
    if is_wave and not _stands_out(state.fit, candidate.effect.frequencies_hz(better.model.rig)):
        return False
    split = [halves(record) for record in state.fit.noise.records]
    if not all(split):
        return True
    for k in (0, 1):
        own = [half[k] for half in split]
        if all(isinstance(record, Record) and record.is_free_response for record in own) and not is_wave:
            if not better.is_adequate:
                return False
            continue  # a step moves one half only: what explains all of that stands
        try:
            fall = _fall_by_wave(state, better, own) if is_wave else _fall(state, better, own)
        except (RecordError, UnstableLoopError):
            continue  # too short to be judged
        if fall < chdtri(candidate.degrees, CHANCE):
            return False
    return True


def _stands_out(fit: Comparison, frequencies_hz: Sequence[float]) -> bool:
    """Whether a wave stands out of the lines beside it, of whichever record.

    It stands on single lines, in both halves alike, whether it is one or noise: that the noise there is as loud as its
    spectrum says, which its score takes for granted, has to be seen.
    """
    for part in fit.noise.in_time:
        near = 2.0 * part.record.sample_rate / part.window.samples
        for tone in part.tones:
            chance = len(part.record.channels) * np.exp(-tone.power)
            if chance < SUSPECTED and any(abs(tone.frequency_hz - own) < near for own in frequencies_hz):
                return True
    return False


def _fall(state: State, better: Comparison, records: Sequence[Measurement]) -> float:
    """By how much the step lowers J of other records; a wave begins them at another angle, and is left out."""
    base = refit(Comparison(undisturbed(state.fit.model), records), step=ROUGHLY)
    return base.cost - refit(base.of(undisturbed(better.model)), step=ROUGHLY).cost


def _fall_by_wave(state: State, better: Comparison, records: Sequence[Measurement]) -> float:
    """The same where it is itself a wave, which alone has the lines that it is judged on."""
    full = refit(Comparison(better.model, records), step=ROUGHLY)
    return refit(full.of(state.fit.model), step=ROUGHLY).cost - full.cost


def halves(record: Measurement) -> tuple[Measurement, ...]:
    """Both halves of a record, of whole periods, or every other band of a response; nothing if too short."""
    if isinstance(record, FrequencyResponse):
        is_first = np.arange(len(record.frequency_hz))[::-1] // BESIDE % 2 == 0
        return (record.some(is_first), record.some(~is_first)) if len(is_first) >= LEAST_FREQUENCIES else ()
    if record.period is None:
        middle = record.samples // 2
        if middle < LEAST_SAMPLES:
            return ()
    else:
        if record.periods < 2 * LEAST_PERIODS:
            return ()
        middle = record.periods // 2 * record.period
    return record.rows(0, middle), record.rows(middle, record.samples)
