"""How records begin: what the numbers cost that say how the states of linear effects do.

States that effects add begin each record settled, or at rest, or nearly so: the n further numbers c, in units of their
errors, that are fitted to how a record begins have one variance before it about the likelier of both, which is found.
With m the mean of c^2 they then lower J by n (m - 1 - log m) where m > 1, and not at all where they are no more than
chance brings (MacKay, Neural Comput. 4 (1992) 415). The parameters are those at which both together are least: a
direction that J hardly determines may begin the records far from any rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import UnstableLoopError
from ambid.identification.covariance import inverted
from ambid.model import Model, Parameter
from ambid.noise import Comparison, Noise
from ambid.noise.known import known_residual

NEAR, MOST_STEPS = 0.1, 20
"""Fall of minus the log evidence that distinguishes no sets, and steps towards the likeliest beginnings."""


def beginnings(fits: Sequence[tuple[Comparison, Comparison, Sequence[FloatArray]]]) -> float:
    """What they cost beyond half of the least J of these records.

    Parameters
    ----------
    fits : sequence of (Comparison, Comparison, sequence of ndarray)
        Of some records each: the set, the base model, and the transients of that, whitened.
    """
    begun: list[_Begun] = []
    for fit, base, known in fits:
        if own := _Begun.of(fit, base, known, is_first=not begun):
            begun.append(own)
    if not begun:
        return 0.0
    if not fits[0][0].model.is_linear:
        return _towards_rest(begun)[1]
    least = _least(begun)
    for _ in range(MOST_STEPS):
        step, foreseen = _towards_rest(begun)
        try:
            further = [own.moved(step) for own in begun] if foreseen < _cost(begun) - NEAR else begun
        except UnstableLoopError:
            break
        if _cost(further) > _cost(begun) - NEAR:
            break
        begun = further
    return max(0.0, _cost(begun) - least)


def _least(begun: Sequence[_Begun]) -> float:
    """Half of J of some records where it is least, a step of Newton's away."""
    scale = np.array([p.scale for p in begun[0].parameters])
    gradient = scale * sum(own.of_cost for own in begun)
    inverse, _ = inverted(sum(own.hessian for own in begun) * np.outer(scale, scale))
    return 0.5 * (sum(own.cost for own in begun) - float(gradient @ inverse @ gradient))


def _towards_rest(begun: Sequence[_Begun]) -> tuple[FloatArray, float]:
    """The step to where J and what records cost that begin far from rest are least, and what is foreseen there."""
    parameters = begun[0].parameters
    scale, lower, upper = np.array([(p.scale, p.lower - p.value, p.upper - p.value) for p in parameters]).T
    best, least, step = np.zeros(len(scale)), np.inf, np.zeros(len(scale))
    for _ in range(MOST_STEPS):
        foreseen = _cost(begun, step)
        if foreseen > least - NEAR:
            break
        best, least = step, foreseen
        weights = [1.0 / max(1.0, own.squares(step) / own.numbers) for own in begun]
        form = sum(own.hessian + weight * own.form for own, weight in zip(begun, weights, strict=True))
        gradient = sum(own.of_cost + weight * own.gradient for own, weight in zip(begun, weights, strict=True))
        inverse, _ = inverted(form * np.outer(scale, scale))
        step = np.clip(-scale * (inverse @ (scale * gradient)), lower, upper)
    return best, least


def _cost(begun: Sequence[_Begun], step: FloatArray | None = None) -> float:
    """Half of J of some records, and what the numbers cost by which they begin; so far from there."""
    found = 0.0
    for own in begun:
        rise = 0.0 if step is None else float(step @ (own.of_cost + 0.5 * own.hessian @ step))
        variance = (own.least if step is None else own.squares(step)) / own.numbers
        found += 0.5 * (own.cost + own.numbers * _surprise(variance)) + rise
    return found


def _surprise(variance: float) -> float:
    """What numbers of such a variance, in units of their errors, cost, each twice."""
    return 1.0 + float(np.log(variance)) if variance > 1.0 else variance


def _free(model: Model) -> list[int]:
    """All parameters but errors of the rig file, which hardly say how a record begins, and are many."""
    return [k for k, p in enumerate(model.parameters) if p.prior is None]


class _Begun(NamedTuple):
    """The squares of the numbers that say how added states begin the records of a fit, about its parameters.

    Attributes
    ----------
    model : Model
        Linear.
    noise : Noise
    base : list of ndarray
        Transients of the base model, of each record.
    numbers : int
    is_first : bool
        Whether J is counted with what is known beforehand, which counts once.
    least : float
        Sum of squares, in units of their errors.
    gradient, form : ndarray, shapes (q,), (q, q)
        They grow by ``2 gradient' step + step' form step``.
    cost, of_cost, hessian : float, ndarray, ndarray
        J, half of its gradient, and half of its Hessian.
    """

    model: Model
    noise: Noise
    base: Sequence[FloatArray]
    numbers: int
    is_first: bool
    least: float
    gradient: FloatArray
    form: FloatArray
    cost: float
    of_cost: FloatArray
    hessian: FloatArray

    @property
    def free(self) -> list[int]:
        """See `_free`."""
        return _free(self.model)

    @property
    def parameters(self) -> list[Parameter]:
        """Those that are free."""
        return [self.model.parameters[k] for k in self.free]

    def squares(self, step: FloatArray) -> float:
        """Their sum so far from the fit."""
        return max(0.0, self.least + float(2.0 * self.gradient @ step + step @ self.form @ step))

    def moved(self, step: FloatArray) -> _Begun:
        """The same about other parameters."""
        theta = self.model.theta
        theta[self.free] += step
        bounds = np.array([(p.lower, p.upper) for p in self.model.parameters]).T
        model = self.model.with_theta(np.clip(theta, *bounds))
        return self.at(model, self.noise, self.base, self.numbers, is_first=self.is_first)

    @classmethod
    def of(cls, fit: Comparison, base: Comparison, known: Sequence[FloatArray], *, is_first: bool) -> _Begun | None:
        """None where no states were added to the base's."""
        model = fit.model.without_nonlinear()
        fitted, before = (own.noise.quadratic(own.model, []).fitted for own in (fit, base))
        if fitted <= before or not model.is_stable:
            return None
        own = cls.at(model, fit.noise, known, fitted - before, is_first=is_first)
        # of a nonlinear set J is least at the fit, and rises about it as that of its linear part
        return own if fit.model.is_linear else own._replace(cost=0.0, of_cost=np.zeros(len(own.of_cost)))

    @classmethod
    def at(cls, model: Model, noise: Noise, base: Sequence[FloatArray], numbers: int, *, is_first: bool) -> _Begun:
        """Settled or at rest, whichever is nearer."""
        free = _free(model)
        settled = noise.freed(noise.departure(model), base)
        rests = noise.freed(noise.departure_from_rest(model)[0], base)
        if settled @ settled < rests @ rests:
            departure, slopes = settled, noise.slopes(model, free)
        else:
            departure, slopes = rests, noise.departure_from_rest(model, free)[1]
        slopes = noise.freed(slopes, base)
        own = noise.quadratic(model, free)
        least = max(0.0, float(departure @ departure) - own.cost)
        gradient, form = slopes.T @ departure - own.gradient, slopes.T @ slopes - own.hessian
        known = 0.0 if is_first else float(np.sum(known_residual(model) ** 2))
        return cls(
            model, noise, base, numbers, is_first, least, gradient, form, own.cost - known, own.gradient, own.hessian
        )
