"""Before an effect is added: the residual that would be left with it, by channel and band, without any refit."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.diagnosis.candidates import Ranking
from ambid.diagnosis.localisation import MisfitMap, misfit_maps
from ambid.errors import InputError
from ambid.results import band_text, picture, plain


@dataclass(frozen=True)
class Prediction:
    """What adding an effect would leave, to first order; result of `predict`.

    Attributes
    ----------
    effect : str
    misfit_now, misfit_then : float
        J/dof.
    now, then : tuple of MisfitMap
        Of every record: the misfit as it is, and as it would be.
    curves : tuple of tuple of MisfitMap
        The same two in fine bands, for each record.
    """

    effect: str
    misfit_now: float
    misfit_then: float
    now: tuple[MisfitMap, ...]
    then: tuple[MisfitMap, ...]
    curves: tuple[tuple[MisfitMap, MisfitMap], ...]

    plot = picture("plot_prediction")

    def part(self, record: int = 0) -> FloatArray:
        """By how much the misfit would fall in each band and channel, in times noise, shape (bands, channels)."""
        return np.asarray(self.now[record].misfit - self.then[record].misfit)

    def lines(self, most: int = 5) -> list[str]:
        """The misfit now and then, and the cells that would fall most, a line each."""
        cells = []
        for k, (now, then) in enumerate(zip(self.now, self.then, strict=True)):
            part = np.nan_to_num(self.part(k))
            cells += [(part[b, c], now, then, b, c) for b in range(part.shape[0]) for c in range(part.shape[1])]
        cells.sort(key=lambda cell: -cell[0])
        text = [f"{self.effect}: misfit {self.misfit_now:.3f} now, {self.misfit_then:.3f} then (predicted)"]
        for _, now, then, b, c in cells[:most]:
            low, high = now.edges_hz[b : b + 2]
            place = f"  {now.record}: {now.channels[c]:12s} {band_text(low, high):>14s} Hz"
            text.append(f"{place}: {now.misfit[b, c]:.1f} now, {then.misfit[b, c]:.1f} then, times noise")
        return text

    def to_json(self) -> dict[str, Any]:
        """Plain data: the maps of both."""
        return plain(
            {
                "effect": self.effect,
                "misfit_now": self.misfit_now,
                "misfit_then": self.misfit_then,
                "records": [
                    now.as_dict() | {"misfit_then": then.misfit.tolist()}
                    for now, then in zip(self.now, self.then, strict=True)
                ],
            }
        )


def predict(ranking: Ranking, effect: str) -> Prediction:
    """What a candidate of a ranking would leave, beside the residual as it is.

    The change that it makes at its predicted values, and what the known parameters would then absorb, is taken from
    the whitened residual. Nothing is fitted: where the effect is large, the refit leaves less, as a rule.

    Parameters
    ----------
    ranking : Ranking
    effect : str
        Name of one of its candidates.

    Raises
    ------
    InputError
        If it is no candidate of this ranking.
    """
    candidate, comparison = ranking.find(effect), ranking.comparison
    if candidate is None or comparison is None or candidate.direction is None or candidate.residual is None:
        names = ", ".join(own.effect.name for own in ranking.candidates)
        raise InputError(f"{effect}: no candidate of this ranking; it has {names or 'none'}")
    left = candidate.residual - candidate.size * candidate.direction
    now, then = misfit_maps(comparison), misfit_maps(comparison, left)
    fine = misfit_maps(comparison, bands=36), misfit_maps(comparison, left, 36)
    return Prediction(
        effect=candidate.effect.name,
        misfit_now=ranking.misfit,
        misfit_then=candidate.predicted_misfit,
        now=now,
        then=then,
        curves=tuple(zip(*fine, strict=True)),
    )
