"""Measured against simulated, before and after, record by record, those for validation among them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid.diagnosis import Diagnosis
from ambid.noise import Comparison, compare
from ambid.report import pictures
from ambid.report.pictures import Picture

DRAWN = 3
"""Records with pictures of their own, those that the base model misses most: of each they take half a page."""


@dataclass(frozen=True)
class Shown:
    """A record with both models.

    Attributes
    ----------
    name, role : str
    worst : str
        The channel that the base model misses most.
    fit, misfit : tuple of float
        Before and after, in one noise; fit is the average over the displacements [%].
    ceiling : float
        Of the fit [%].
    signals, responses : Picture or None
        In time and over frequency; None of a record that is not drawn, or has no such picture.
    """

    name: str
    role: str
    worst: str
    fit: tuple[float, float]
    misfit: tuple[float, float]
    ceiling: float
    signals: Picture | None = None
    responses: Picture | None = None

    @property
    def pictures(self) -> list[Picture]:
        """Those that there are."""
        return [own for own in (self.signals, self.responses) if own is not None]


def before_and_after(diagnosis: Diagnosis, before: Comparison, is_moved: bool) -> list[Shown]:
    """All records in their order; pictures of those that are missed most.

    Parameters
    ----------
    diagnosis : Diagnosis
    before : Comparison
        Of the base model against the records of the diagnosis.
    is_moved : bool
        Whether the last model is another one.
    """
    after = diagnosis.fit if is_moved else None
    sides = [("diagnosis", before, after)]
    if diagnosis.validation:
        known = diagnosis.kept_back
        was = compare(before.model, diagnosis.validation) if known is None else known
        was = was.of(before.model) if was.is_judged else was
        now = None if after is None or not was.is_judged else was.of(after.model).with_own_angles()
        sides.append(("validation", was, now))
    places = [(role, was, now, k) for role, was, now in sides for k in range(len(was.records))]
    misfits = np.nan_to_num([was.records[k].misfit for _, was, _, k in places], nan=-np.inf)
    drawn = set(np.argsort(-misfits, kind="stable")[:DRAWN].tolist())
    return [_shown(*place, is_drawn=own in drawn) for own, place in enumerate(places)]


def _shown(role: str, before: Comparison, after: Comparison | None, k: int, *, is_drawn: bool) -> Shown:
    pair = before.records[k], (before if after is None else after).records[k]
    fits, misfits = [float(own.as_dict()["fit_percent"]["average"]) for own in pair], [own.misfit for own in pair]
    drawn: dict[str, Any] = {}
    if is_drawn:
        drawn = {"signals": pictures.signals(before, after, k), "responses": pictures.responses(before, after, k)}
    return Shown(
        pair[0].record.name,
        role,
        pair[0].worst.channel,
        (fits[0], fits[1]),
        (misfits[0], misfits[1]),
        float(pair[0].as_dict()["noise_ceiling_percent"]["average"]),
        **drawn,
    )
