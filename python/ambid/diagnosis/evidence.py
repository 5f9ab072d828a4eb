"""How likely is a set of effects, given the records: alone, or beside something else that has no name?

For a set H with q parameters, at the optimum (Laplace's approximation; MacKay, Information Theory, Inference, and
Learning Algorithms, 2003, chapters 27 and 28),

    log p(data | H) = -J/2 - price,    price = 1/2 log det(I + P Psi~' Psi~ / V) + sum of unknown(k) - log p(H)

Psi~ are the whitened slopes of the parameters of its effects, freed from what all others absorb. The k numbers of an
effect that are of one kind, such as the gains of its sensors, are of one size, whose square is P: nothing is known of
it but the three decades that it is within (Jeffreys' prior), and of its direction in their space but the signs that
physics forbids, so that unknown(k) = log(D S_k / (2 pi)^(k/2)), with D the logarithm of the decades and S_k the surface
of the unit sphere. V is 1 where H leaves noise alone.

Something else changes the response as effects of the catalogue may, by any power: w_i are the eigenvalues, of the sum
1, of the mean of the projectors on what each of them can do, so that few ways count where little is left, and more
where much is, however many lines show it. A wave that nothing brings is not smooth: each has two numbers for a channel,
n in all. With E and E_n what H leaves beyond noise between the waves, and where they stand, their power integrated out,

    log p(data | H, something else) = -1/2 sum log(1 + E w_i) - n/2 log(1 + E_n/n) - price,    V = 1 + E/W

with the number W = sum E w_i/(1 + E w_i) of ways that count, and what is learnt of these powers, which were known to
three decades before; the odds of a residual that is looked at along these ways are in `nameless`. Where something else
shows a nonlinear shape, its linear part has no less power than that: a set that leaves none took its place by luck.

States that effects add begin each record settled, or at rest, or nearly so, see `beginnings`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaln, log_ndtr

from ambid.arrays import FloatArray
from ambid.diagnosis.beginnings import beginnings
from ambid.diagnosis.nameless import BEYOND, DECADES, of_any_power
from ambid.effects import Effect
from ambid.errors import UnstableLoopError
from ambid.identification.covariance import inverted
from ambid.model import Model, Parameter
from ambid.noise import Comparison, Quadratic
from ambid.noise.chance import log_odds_against
from ambid.noise.known import known_residual, known_slopes

USUAL = 0.3
"""Effects that a machine has, on average, that its rig file does not hold."""
NAMELESS = float(np.log(0.05))
"""Log of how likely something that the catalogue lacks is before any record."""
INEXACT = float(np.log(0.5))
"""Log of how likely formulas leave what these records show, before any: all are idealised."""
BOUNDLESS = 1e30
"""J of records that a loop cannot have made; a number, as odds are reckoned with it."""
LEVEL = 0.03
"""Relative standard deviation of the level of a noise spectrum, beside what counts its lines."""
SURE = 0.9
"""Probability from which on effects are named, and a set is called the explanation."""
LARGEST_SCORE = 1e4
"""Beyond all that is needed."""
PART = 0.01
"""Of its size by which a parameter of a nonlinear effect is changed to see what it changes."""
DISTINCT = float((1.645 + np.sqrt(1.645**2 + 2.0 * np.log(SURE / (1.0 - SURE)))) ** 2)
"""Mean difference lambda of J by which two sets of as many parameters are distinguished in 95 % of records, where
one is to be `SURE`: J1 - J2 has the mean lambda and the standard deviation 2 sqrt(lambda)."""
OF_FORMULAS = 0.015
"""Part of what effects explain that their formulas, which are idealised, may leave."""
SHAPE_OF_FORMULAS = 0.05
"""Part of what effects explain of records without periods that their formulas may leave as a shape, or in the ways of
effects: what stood in for friction and dead bands left 17 to 60 % of that, the coil of a levitator that was bought 0.6
to 1.7 %."""


def deviation(fit: Comparison) -> float:
    """Standard deviation of the J of a right model."""
    return float(np.hypot(fit.noise.scatter * np.sqrt(2.0 * fit.dof), LEVEL * fit.dof))


class Kind(NamedTuple):
    """Parameters of an effect that share their size: so many, some of which have one sign."""

    numbers: int
    one_sided: int

    @property
    def unknown(self) -> float:
        """What their unknown size costs beside their precision."""
        k = self.numbers
        log_surface = np.log(2.0) + 0.5 * k * np.log(np.pi) - gammaln(0.5 * k)
        of_size = np.log(DECADES * np.log(10.0)) - np.log(2.0) * self.one_sided
        return float(of_size + log_surface - 0.5 * k * np.log(2.0 * np.pi))


@dataclass(frozen=True)
class Evidence:
    """What distinguishes one set from another.

    Attributes
    ----------
    cost : float
        J of all records, those to validate on included.
    expected, deviation : float
        Of a right model, mean and standard deviation of that.
    formula_errors : mapping of frozenset of str to float
        By the names of the others, part of what an effect explains beside them that its formula may leave.
    usual_errors : mapping of frozenset of str to float
        The same of what they leave as a rule.
    beginnings : float
        What the numbers cost that say how records begin, beyond those of the base model.
    information : ndarray, shape (q, q)
        Of the parameters of the effects, in units of their size, freed from what all others absorb.
    kinds : tuple of Kind
        Of these parameters, in their order.
    prior : float
        Minus the log of how likely its effects are before any record.
    on_tones, waves : float, int
        J where waves stand that may be no part of the excitation, and how many numbers these are.
    """

    cost: float
    expected: float
    deviation: float
    formula_errors: Mapping[frozenset[str], float]
    usual_errors: Mapping[frozenset[str], float]
    beginnings: float
    information: FloatArray
    kinds: tuple[Kind, ...]
    prior: float
    on_tones: float = 0.0
    waves: int = 0

    def price(self, left: float = 1.0) -> float:
        """What the parameters of the effects and their number cost, where so much variance is left."""
        _, log_det = np.linalg.slogdet(np.eye(len(self.information)) + self.information / left)
        unknown = sum(kind.unknown for kind in self.kinds)
        return float(0.5 * log_det) + unknown + self.beginnings / left + self.prior

    @property
    def alone(self) -> float:
        """Log evidence where nothing else is missing."""
        return -0.5 * self.cost - self.price()

    @property
    def beyond(self) -> float:
        """By how much J is above that of a right model, beyond chance."""
        return max(0.0, self.cost - self.expected - BEYOND * self.deviation)

    @property
    def against(self) -> float:
        """Log of the odds against noise of this power, at the most."""
        return log_odds_against(float(log_ndtr((self.expected - self.cost) / self.deviation)))

    def beside(
        self, left: float, least: Evidence, ways: FloatArray, shape: float = 0.0, prior: float = NAMELESS
    ) -> float:
        """Log evidence beside something else, where this set leaves so much of J beyond noise, and that the least.

        Something else changes the response in ways of such powers, and shows a shape of such a score; `prior` is the
        log of how likely it is before any record. It has states of its own, too, which begin as those do of the set
        that leaves least.
        """
        of_waves = min(left, max(0.0, self.on_tones - least.on_tones))
        smooth = left - of_waves
        cost = of_any_power(smooth, ways, shape) - of_any_power(least.beyond, ways)
        cost += of_any_power(of_waves, np.full(self.waves, 1.0 / max(1, self.waves)))
        variance = 1.0 + smooth / max(1.0, float(np.sum(smooth * ways / (1.0 + smooth * ways))))
        own = replace(self, beginnings=variance * max(self.beginnings, least.beginnings))
        return prior - cost - own.price(variance)


def by_score(fit: Comparison, misfit: float, score: float, degrees: int, one_sided: int, prior: float) -> Evidence:
    """Of a set with one effect more than a fit has, by its score and the misfit J/dof that it promises."""
    cost = max(1.0, misfit) * fit.dof
    return Evidence(
        cost=cost,
        expected=float(fit.dof),
        deviation=deviation(fit),
        formula_errors={},
        usual_errors={},
        beginnings=0.0,
        information=np.eye(degrees) * max(0.0, score),
        kinds=(Kind(degrees, one_sided),) if degrees else (),
        prior=prior,
    )


def posterior(tried: Sequence[Evidence], ways: FloatArray) -> FloatArray:
    """Probability of each of some sets, whatever is beside it."""
    least = max(tried, key=lambda own: own.alone)
    left = [least.beyond + max(0.0, own.cost - least.cost) for own in tried]
    logs = [
        np.logaddexp(own.alone + 0.5 * least.cost - least.against, own.beside(beyond, least, ways))
        for own, beyond in zip(tried, left, strict=True)
    ]
    weight = np.exp(np.array(logs) - max(logs))
    return np.asarray(weight / weight.sum())


def price_of(score: float, degrees: int, one_sided: int, prior: float) -> float:
    """What an effect would cost beside a set, by its score."""
    precision = 0.5 * degrees * np.log(1.0 + max(0.0, score))
    return float(precision + Kind(degrees, one_sided).unknown + prior)


def needed(degrees: int, one_sided: int, prior: float) -> float:
    """Score from which on an effect is `SURE` where it alone is missing."""

    def odds(score: float) -> float:
        return 0.5 * score - price_of(score, degrees, one_sided, prior) - np.log(SURE / (1.0 - SURE))

    return float(brentq(odds, 4.0 * degrees, LARGEST_SCORE))


class Yardstick:
    """What the evidence of all sets in one noise is measured with: the transients of the base model.

    Parameters
    ----------
    base : Comparison
        Of the records.
    kept_back : Comparison or None
        Of those to validate on.
    prior : mapping of str to float
        Expected number of each effect before any record.
    """

    def __init__(self, base: Comparison, kept_back: Comparison | None, prior: Mapping[str, float]) -> None:
        self.base, self.kept_back, self.prior = base, kept_back, prior
        self._before = [(own, own.noise.transients(own.model)) for own in (base, kept_back) if own is not None]

    def evidence(
        self,
        fit: Comparison,
        kept_back: Comparison | None,
        added: Sequence[Effect],
        variants: float,
        *,
        is_priced: bool = True,
    ) -> Evidence:
        """Of a set at its optimum, whose effects are the best of so many independent variants.

        That of a set that J alone leaves far behind need not be priced: it is no more than is returned.
        """
        prefixes = tuple(f"{effect.name}." for effect in added)
        parameters = fit.model.parameters
        own = [k for k, p in enumerate(parameters) if p.name.startswith(prefixes)] if prefixes else []
        kinds = _kinds(parameters, own) if is_priced else []
        about = about_sizes(fit, kinds) if is_priced else np.zeros((len(parameters), len(parameters)))
        cost, expected, variance = fit.cost, float(fit.dof), deviation(fit) ** 2
        on_tones, waves = fit.noise.on_tones(fit.model)
        fits = [(fit, *self._before[0])]
        if kept_back is not None and self.kept_back is not None:
            try:
                further = _further_cost(about, kept_back) if is_priced else kept_back.cost
                dof = kept_back.dof + len(fit.model.free)  # nothing further is fitted to them
                fits.append((kept_back, *self._before[1]))
                at_waves = kept_back.noise.on_tones(kept_back.model)
                on_tones, waves = on_tones + at_waves[0], waves + at_waves[1]
            except UnstableLoopError:  # no such record was made by a loop that leaves all bounds
                further, dof = BOUNDLESS, kept_back.noise.lines
            cost, expected = cost + further, expected + dof
            variance += deviation(self.kept_back) ** 2
        names = frozenset(effect.name for effect in added)
        errors = {names - {own.name}: own for own in added if own.formula_error}
        return Evidence(
            cost=cost,
            expected=expected,
            deviation=float(np.sqrt(variance)),
            formula_errors={rest: own.formula_error for rest, own in errors.items()},
            usual_errors={rest: own.leaves_as_a_rule for rest, own in errors.items()},
            beginnings=beginnings(fits) if is_priced else 0.0,
            information=information_on(about, fit.model, kinds),
            kinds=tuple(Kind(len(own), sum(parameters[k].lower >= 0.0 for k in own)) for own in kinds),
            prior=float(np.log(variants)) - sum(self._usual(effect) for effect in added),
            on_tones=on_tones,
            waves=waves,
        )

    def _usual(self, effect: Effect) -> float:
        """Log of how likely an effect is before any record; a shape without a name is as likely as one that has one."""
        return float(np.log(self.prior.get(effect.name, USUAL / max(1, len(self.prior)))))

    def motion(self, base: Evidence) -> Evidence:
        """Of a machine that does not move at all, beside that of the base model."""
        measured = [own.noise.measured_cost for own in (self.base, self.kept_back) if own is not None]
        return replace(base, cost=sum(measured))


def _further_cost(about: FloatArray, kept_back: Comparison) -> float:
    """By how much J of the records that a model was fitted to and of others, at its least, is above J of the first.

    One step of Newton's leads there, by J'J of the first. What a fit to little does not determine, the others correct.
    """
    own, further = kept_back.model, _about(kept_back)
    known, slopes = known_residual(own), known_slopes(own, range(len(own.names)))  # which count once
    scale = np.array([p.scale for p in own.parameters])
    gradient = (further.gradient + slopes.T @ known) * scale
    hessian = about + further.hessian - slopes.T @ slopes
    inverse, _ = inverted(hessian * np.outer(scale, scale))
    return further.cost - float(known @ known) - float(gradient @ inverse @ gradient)


def _about(fit: Comparison) -> Quadratic:
    """J about a model, by all its parameters; see `RecordLines.white` for derivatives of a nonlinear one."""
    return fit.noise.quadratic(fit.model, range(len(fit.model.names)), roughly=True)


def _change(fit: Comparison, settled: FloatArray, k: int, size: float) -> FloatArray:
    """What a parameter takes off what the settled response leaves, were it changed by its size, by a part of that.

    The derivatives of a stiff law, such as dry friction, may grow from step to step where its value does not.
    """
    theta = fit.model.theta

    def by(part: float) -> FloatArray:
        moved = theta.copy()
        moved[k] += part * size
        found = (fit.noise.departure(fit.model.with_theta(moved)) - settled) / part
        return fit.noise.freed(found, fit.noise.transients(fit.model))

    if theta[k] + PART * size > fit.model.parameters[k].upper:
        return by(-PART)
    try:
        return by(PART)
    except UnstableLoopError:  # at the edge of stability, which the other side leads away from
        return by(-PART)


def _kinds(parameters: Sequence[Parameter], own: Sequence[int]) -> list[list[int]]:
    """Which of some parameters are of one kind: those of one effect that are probed alike."""
    kinds: dict[tuple[str, str, float | None], list[int]] = {}
    for k in own:
        p = parameters[k]
        kinds.setdefault((p.name.partition(".")[0], p.unit, p.typical), []).append(k)
    return list(kinds.values())


def _sizes(model: Model, kinds: Sequence[Sequence[int]]) -> FloatArray:
    """Of every parameter: the scale of one that is of none of these kinds, shape (parameters,)."""
    size = np.array([p.scale for p in model.parameters])
    for kind in kinds:
        size[kind] = np.linalg.norm(model.theta[kind])
    return size


def about_sizes(fit: Comparison, kinds: Sequence[Sequence[int]]) -> FloatArray:
    """J'J about a fit by all its parameters; by those of some kinds from what they change, not from derivatives."""
    own, size = [k for kind in kinds for k in kind], _sizes(fit.model, kinds)
    if fit.model.is_linear or not own:
        return _about(fit).hessian
    size = np.where(size > 0.0, size, [p.scale for p in fit.model.parameters])  # what fell to zero has none
    others = [k for k in range(len(size)) if k not in own]
    _, slopes = fit.noise.jacobian(fit.model, others, roughly=True)
    settled = fit.noise.departure(fit.model)
    rows = np.empty((len(settled), len(size)))
    rows[:, others] = slopes
    rows[:, own] = np.transpose([_change(fit, settled, k, size[k]) / size[k] for k in own])
    return np.asarray(rows.T @ rows)


def information_on(about: FloatArray, model: Model, kinds: Sequence[Sequence[int]]) -> FloatArray:
    """Of parameters of some kinds, in units of the size of each, freed from what all others absorb, shape (q, q).

    Parameters
    ----------
    about : ndarray, shape (parameters, parameters)
        J'J by all parameters of the model.
    """
    own, size = [k for kind in kinds for k in kind], _sizes(model, kinds)
    if not own:
        return np.zeros((0, 0))
    others = [k for k in range(len(size)) if k not in own]
    hessian = about * np.outer(size, size)
    cross = hessian[np.ix_(own, others)]
    among = hessian[np.ix_(others, others)]
    return np.asarray(hessian[np.ix_(own, own)] - cross @ np.linalg.pinv(among, hermitian=True) @ cross.T)
