"""Does an effect that is found where the base model is within noise stand in every part of the records?

What is local in a record, such as a burst, a standstill or a wrong sample, can look like physics: but not on records
to validate on, or, where there are none, on each half of those that it was found on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from ambid.errors import RecordError, UnstableLoopError
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY
from ambid.noise import Comparison
from ambid.noise.angles import undisturbed
from ambid.noise.halves import LEAST_SAMPLES
from ambid.record import Measurement

CHANCE = 0.05
"""Chance of the fall of J that each half must show: what is just sure on a whole record shows half of its score on each
half, and passes 95 % where that score is 15."""
BESIDE = 4
"""Neighbouring frequencies of a response that stay together, since they may have an error in common: bands of a local
estimate."""
LEAST_FREQUENCIES = 16
"""Frequencies of a response whose halves are judged."""


def is_everywhere(before: Comparison, after: Comparison) -> bool:
    """Whether both halves of the records show what a set of effects brings; where they are too short, it is taken so.

    Parameters
    ----------
    before, after : Comparison
        Of the base model, which is within noise, and of the set.
    """
    records = after.noise.records
    own = after.model.effects[len(before.model.effects) :]
    is_wave = any(effect.quarters(after.model.rig) for effect in own)
    degrees = len(after.model.names) - len(before.model.names)
    split = [halves(record) for record in records]
    for k in (0, 1) if all(split) else ():
        some = [half[k] for half in split]
        if all(record.is_free_response for record in some) and not is_wave:
            continue  # a step moves one half only
        try:
            fall = (_fall_by_wave if is_wave else _fall)(before, after, some)
        except (RecordError, UnstableLoopError):
            continue  # too short to be judged
        if fall < chdtri(degrees, CHANCE):
            return False
    return True


def _fall(before: Comparison, better: Comparison, records: Sequence[Measurement]) -> float:
    """By how much the step lowers J of other records; a wave begins them at another angle, and is left out."""
    base = refit(Comparison(undisturbed(before.model), records), step=ROUGHLY)
    return base.cost - refit(base.of(undisturbed(better.model)), step=ROUGHLY).cost


def _fall_by_wave(before: Comparison, better: Comparison, records: Sequence[Measurement]) -> float:
    """The same where it is itself a wave, which alone has the lines that it is judged on."""
    full = refit(Comparison(better.model, records), step=ROUGHLY)
    return refit(full.of(before.model), step=ROUGHLY).cost - full.cost


def halves(record: Measurement) -> tuple[Measurement, ...]:
    """Both halves of a record, of whole periods, or every other band of a response; nothing if too short."""
    if not record.is_in_time:
        is_first = np.arange(len(record.frequency_hz))[::-1] // BESIDE % 2 == 0
        return (record.some(is_first), record.some(~is_first)) if len(is_first) >= LEAST_FREQUENCIES else ()
    if record.period is None:
        middle = record.samples // 2
        if middle < LEAST_SAMPLES:
            return ()
    else:
        if record.periods < 4:
            return ()
        middle = record.periods // 2 * record.period
    return record.rows(0, middle), record.rows(middle, record.samples)
