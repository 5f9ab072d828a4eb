"""What to measure next: the cheapest experiment that would tell the rest apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.diagnosis.localisation import Localisation
from ambid.diagnosis.result import Step

ENOUGH = 26.0
"""Evidence that tells two effects apart with 95 % certainty."""
TWINS = 0.999
"""Effects whose freed responses have a larger cosine are the same in this kind of record."""


def next_experiment(
    verdict: str, sets: Sequence[Sequence[str]], where: Localisation, history: Sequence[Step], *, others: str
) -> str:
    """In words.

    Parameters
    ----------
    verdict : str
    sets : sequence of sequence of str
        Effects that cannot be told apart.
    where : Localisation
        Of the base model.
    history : sequence of Step
        With the ranking before each step.
    others : str
        What the explanation holds for: ``amplitudes``, ``operating points``, or nothing beyond one of them.
    """
    if verdict == "adequate":
        return "nothing is needed in this band and at this amplitude; a larger one would show nonlinear effects"
    if verdict == "ambiguous":
        return "; ".join(_apart(names, history) for names in sets)
    if verdict == "explained":
        if others == "operating points":
            return "nothing is needed: one model meets the records of all these operating points"
        if others:
            return "nothing is needed here; another bias current or speed would show whether the effect follows it"
        return "validate on a record at another amplitude or bias current"
    cell = where.cells[0]
    if cell.kind == "drift":
        return "repeat when the machine is warm and its supplies have settled, and record temperature and bias current"
    if cell.kind == "synchronous":
        return f"record without excitation and look for what goes on at {np.mean(cell.band_hz):.2f} Hz"
    return (
        f"the misfit is largest in {cell.channel} from {cell.band_hz[0]:.0f} to {cell.band_hz[1]:.0f} Hz: repeat at "
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
            f"{text}more periods would not do, since they are the same in such a record: record i_c if it is missing, "
            "or measure at another bias current, speed or controller gain, and diagnose the records together"
        )
    return f"to tell {' from '.join(names)}: measure at another amplitude, bias current or controller gain"
