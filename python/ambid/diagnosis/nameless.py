"""Something that the catalogue lacks: it changes the response in the ways that effects have, by any power.

The whitened changes that each effect can make, freed from what the known parameters absorb, span a space, on which P is
the projector; K is the mean of all P. Something that has no name adds a random change of the covariance sK to the
residual, or one of the same power s in all directions in which K is not zero, as likely. Of s nothing is known but the
decades that it is within from where it is seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ambid.arrays import FloatArray

DECADES = 3.0
"""Within so many decades is the size of an effect, or the power of something else, known before any record."""
BEYOND = 2.0
"""Standard deviations of J above a right model's from which on something is left."""
UNRANKED = np.full(20, 0.05)
"""Powers where no effects were ranked."""
OWN = 1e-9
"""Part of the largest eigenvalue below which a way is that of other effects."""
POWERS = np.geomspace(1.0, 10.0**DECADES, 60)
"""Of something else, from the least on, at which it is judged."""
MOST_POWER = 1e9
"""Beyond all that is measured."""


class Shown(NamedTuple):
    """What a residual shows of something else.

    Attributes
    ----------
    odds : float
        Log of the odds for it against noise alone.
    explains, beyond : float
        J that it would explain, and how much of that is beyond chance.
    power : float
        Of the residual in the ways of effects; noise alone has 1 on average in each.
    ways : int
        How many these are; none where there is no residual to look at.
    """

    odds: float = 0.0
    explains: float = 0.0
    beyond: float = 0.0
    power: float = 0.0
    ways: int = 0


@dataclass(frozen=True)
class Ways:
    """In which ways effects may change the response.

    Attributes
    ----------
    rows : ndarray, shape (ways, numbers)
        An orthonormal basis of what each effect can do over the root of its dimension, one effect after the other.
    effects : tuple of str
        Whose each row is.
    spreads : ndarray, shape (numbers,)
        Variance that each number of a right model's residual has, since noise spectra are estimated.
    """

    rows: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    effects: tuple[str, ...] = ()
    spreads: FloatArray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def _gram(self) -> FloatArray:
        return np.asarray(self.rows @ self.rows.T)

    @cached_property
    def powers(self) -> FloatArray:
        """Eigenvalues of K over its trace: all effects act as much, and the sum is one."""
        powers = np.maximum(np.linalg.eigvalsh(self._gram), 0.0) if len(self.rows) else np.zeros(1)
        return np.asarray(powers / powers.sum()) if powers.any() else UNRANKED

    def shown(self, residual: FloatArray, known: Sequence[str]) -> Shown:
        """What the residual of a set of effects shows of something else, freed from what these absorb.

        With z the residual in the eigenvectors of K and w its eigenvalues, the log of the odds at the power s is
        ``sum(z^2 s w/(1 + s w) - log(1 + s w))/2`` (MacKay, 2003, chapter 28).
        """
        if self.rows.shape[1:] != residual.shape:  # of other lines
            return Shown()
        is_known = np.isin(self.effects, known)
        gram, called_for = self._gram, self.rows @ residual
        of_known = gram[np.ix_(~is_known, is_known)] @ np.linalg.pinv(gram[np.ix_(is_known, is_known)], hermitian=True)
        called_for = called_for[~is_known] - of_known @ called_for[is_known]
        values, vectors = np.linalg.eigh(
            gram[np.ix_(~is_known, ~is_known)] - of_known @ gram[np.ix_(is_known, ~is_known)]
        )
        kept = values > OWN * np.trace(gram)
        across = vectors.T[kept] / np.sqrt(values[kept])[:, None]
        directions = across @ (self.rows[~is_known] - of_known @ self.rows[is_known])
        squares = (across @ called_for) ** 2 / (directions**2 @ self.spreads)
        as_effects = _shown(squares, values[kept] / np.trace(gram))
        alike = _shown(squares, np.full(len(squares), 1.0 / max(1, len(squares))))
        odds = float(np.logaddexp(as_effects.odds, alike.odds) - np.log(2.0))
        return max(as_effects, alike)._replace(odds=odds)


def _shown(squares: FloatArray, powers: FloatArray) -> Shown:
    """By the squares of a residual in some directions, whose powers are so at the power 1."""

    def odds(power: FloatArray) -> FloatArray:
        shares = power[:, None] * powers
        return np.asarray(0.5 * np.sum(squares * shares / (1.0 + shares) - np.log1p(shares), axis=1))

    every = np.geomspace(1.0, MOST_POWER, 181)
    best = float(every[np.argmax(odds(every))])
    within = POWERS * max(1.0, best / np.sqrt(POWERS[-1]))
    odds_of_any = float(logsumexp(odds(within)) - np.log(len(within)))
    parts = best * powers / (1.0 + best * powers)
    explains, by_chance = float(squares @ parts), float(np.sum(parts) + BEYOND * np.sqrt(2.0 * np.sum(parts**2)))
    return Shown(odds_of_any, explains, max(0.0, explains - by_chance), float(np.sum(squares)), len(squares))


def of_any_power(beyond: float, ways: FloatArray, least: float = 0.0) -> float:
    """What numbers of one unknown power cost that hold so much beyond noise, of which at least is expected.

    Their powers are as `ways`, whose sum is one.
    """
    if beyond < least:
        power = 1.0 + least * ways
        return 0.5 * float(np.sum(np.log(power) + (1.0 + beyond * ways) / power - 1.0))
    if beyond <= 0.0 or not len(ways):
        return 0.0
    power = 1.0 + beyond * ways
    # it is known to a factor e^s, 2/s^2 = sum (1 - 1/power)^2 (Laplace), of the decades that it was within before
    spread = float(np.sqrt(4.0 * np.pi / np.sum((1.0 - 1.0 / power) ** 2)))
    return 0.5 * float(np.sum(np.log(power))) + max(0.0, float(np.log(DECADES * np.log(10.0) / spread)))
