"""The smallest size of each effect that an experiment would show, and which others it could be taken for.

An effect of size a changes the whitened record by a psi, of which the known parameters absorb a part; what is left,
a psi~, has the score S = a^2 |psi~|^2 in the mean beyond chance. Seen half of the time is the size that half of all
records name: there their scores make the effect as probable as a diagnosis asks for. Of the effects that it could be
taken for, another with the response phi~ explains the part rho^2 of it; the rest, lambda = S (1 - rho^2),
distinguishes them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import chndtr

from ambid.arrays import FloatArray
from ambid.diagnosis.evidence import DISTINCT, USUAL, needed
from ambid.diagnosis.ranking import CONFUSABLE, Point, see
from ambid.effects import CATALOGUE, Effect, EffectParameter, Seen
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.minimum import SUBSTEPS
from ambid.noise import Comparison
from ambid.noise.chance import independent_tests
from ambid.rig import Rig
from ambid.threads import with_one_blas_thread

FELT = 1e-9
"""Part of a response that is left beside the known parameters, below which an effect moves nothing else."""
UNFELT = 1e-6
"""Whitened response of a typical size that is as good as none: a million times as much would not show either."""
WITHIN = (-3.0, 3.0)
"""Logarithms of the sizes of nonlinear effects that are tried, in units of a typical one."""


@dataclass(frozen=True)
class Visible:
    """What an experiment would show of one effect.

    Attributes
    ----------
    effect : str
    parameter, unit : str
        Of the number that is the effect's size: where it is zero there is no effect. What else the effect has stays as
        is typical, other sizes at zero.
    size : float
        Of it, that half of all such records show; NaN where physics does not allow as much.
    typical : float
        A typical small size.
    score : float
        Of the typical size, in the mean beyond chance.
    settings : dict
        Of the variant, such as its place.
    twins : dict of str to float
        Effects whose response is alike, each with the factor in size, beyond the typical one, from which they are
        distinguished with 95 % certainty; infinite where never.
    """

    effect: str
    parameter: str
    unit: str
    size: float
    typical: float
    score: float
    settings: dict[str, Any]
    twins: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Visibility:
    """What an experiment would show; result of `visible`.

    Attributes
    ----------
    effects : tuple of Visible
        In the order of the catalogue.
    not_shown : dict of str to str
        Effects that no such record shows, and why.
    """

    effects: tuple[Visible, ...]
    not_shown: dict[str, str]

    def find(self, name: str) -> Visible | None:
        """The effect of that name, if it is shown."""
        return next((own for own in self.effects if own.effect == name), None)


@dataclass(frozen=True, eq=False)
class _Felt:
    """What is left beside the known parameters of the response to a variant of an effect.

    Attributes
    ----------
    effect : Effect
    sizes : tuple of EffectParameter or None
        Of each probe the parameter that is its size.
    columns : ndarray, shape (numbers, probes)
    basis : ndarray, shape (numbers, degrees)
        Orthonormal.
    one_sided : int
        So many of its amplitudes can only have one sign.
    level : float
        Mean score beyond chance of which half of all records name it.
    """

    effect: Effect
    sizes: tuple[EffectParameter | None, ...]
    columns: FloatArray
    basis: FloatArray
    one_sided: int
    level: float = np.nan

    @property
    def best(self) -> int:
        """The probe that shows best."""
        return int(np.argmax(np.linalg.norm(self.columns, axis=0)))

    @property
    def excess(self) -> float:
        """Score of the probe that shows best, over its level."""
        return float(np.sum(self.columns[:, self.best] ** 2)) / self.level


@with_one_blas_thread
def visible(comparison: Comparison, catalogue: Sequence[Effect] = CATALOGUE) -> Visibility:
    """Tell what an experiment would show of every effect that the model does not have.

    Parameters
    ----------
    comparison : Comparison
        Of the model with what it would record, see `Prospect.comparison`.
    catalogue : sequence of Effect

    Returns
    -------
    Visibility
        Of each effect the variant and the parameter that show best.
    """
    point, present = Point(comparison), {own.name for own in comparison.model.effects}
    seen = replace(see(comparison), held=())  # what holds the weight is not simulated
    others = [effect for effect in catalogue if effect.name not in present]
    candidates = sum(comparison.model.home_of(effect) is not None for effect in others)
    felt: dict[str, list[_Felt]] = {}
    not_shown = {}
    for effect in others:
        found, why = _variants(point, seen, effect, candidates)
        if found:
            felt[effect.name] = found
        else:
            not_shown[effect.name] = why
    rows = []
    for name, variants in felt.items():
        own = max(variants, key=lambda one: one.excess)
        parameter = own.sizes[own.best]
        if parameter is None:
            not_shown[name] = "its probes are other values of what it has; there is no one number that is its size"
            continue
        response = own.columns[:, own.best]
        score = float(response @ response)
        twins = {}
        for other, its in felt.items():
            share = max(float(np.sum((one.basis.T @ response) ** 2)) / score for one in its)
            if other != name and share > CONFUSABLE**2:
                twins[other] = float(np.sqrt(DISTINCT / (1.0 - share) / score)) if 1.0 - share > FELT else float("inf")
        size = _size(point, own, parameter)
        settings = own.effect.settings()
        rows.append(Visible(name, parameter.name, parameter.unit, size, parameter.probe, score, settings, twins))
    return Visibility(tuple(rows), not_shown)


def _variants(point: Point, seen: Seen, effect: Effect, candidates: int) -> tuple[list[_Felt], str]:
    """What is felt of the variants of an effect, and why nothing is."""
    home = point.exact.home_of(effect)
    if home is None:
        return [], effect.why_not(seen.rig)
    variants = effect.variants(replace(seen, rig=home))
    found, why = [], effect.unseen
    for variant in variants:
        try:
            rows = point.responses(variant)
        except (UnstableLoopError, ModelError) as error:
            why = str(error)
            continue
        whole = float(np.linalg.norm(rows))
        columns = point.freed(rows).T
        if not np.linalg.norm(columns) > max(FELT * whole, UNFELT):
            why = "the known parameters absorb all of it" if whole > UNFELT else "nothing of it is in such a record"
            continue
        sizes = tuple(_size_of_probe(variant, probe, home) for probe in variant.probes(home))
        lower, _ = variant.amplitudes(home)
        found.append(_Felt(variant, sizes, columns, _basis(columns), int(np.sum(lower == 0.0))))
    if not found:
        return [], why
    bases = np.hstack([own.basis for own in found])
    tests = candidates * independent_tests(bases.T @ bases, len(found))
    return [replace(own, level=_level(own.basis.shape[1], own.one_sided, tests)) for own in found], why


@lru_cache
def _level(degrees: int, one_sided: int, tests: float) -> float:
    """Mean score beyond chance of an effect that half of all records name: that whose median is what is needed."""
    score = needed(degrees, one_sided, float(np.log(tests / USUAL)))
    return float(brentq(lambda mean: chndtr(score, degrees, mean) - 0.5, 0.0, 2.0 * score, xtol=0.01))


def _size_of_probe(effect: Effect, probe: Mapping[str, float], rig: Rig) -> EffectParameter | None:
    """The one parameter that a probe moves from zero, or from all but zero, with the probe's value."""
    moved = [p for p in effect.parameters(rig) if probe[p.name]]
    from_zero = [p for p in moved if p.lower <= 0.0 <= p.upper]
    # part of its typical size below which a number is as good as zero: a delay may not be zero, but all but
    found = from_zero or [p for p in moved if p.lower <= 1e-3 * abs(probe[p.name])]
    return replace(found[0], probe=float(probe[found[0].name])) if len(found) == 1 else None


def _size(point: Point, felt: _Felt, parameter: EffectParameter) -> float:
    """Size whose score has the level; of a nonlinear effect by its response at that size."""
    probe = felt.effect.probes(point.exact.home_of(felt.effect) or point.exact.rig)[felt.best]
    factor = 1.0 / np.sqrt(felt.excess)
    if not point.exact.add(felt.effect, probe).is_linear:
        factor = _factor(point, felt, dict(probe), parameter)
    size = float(factor * parameter.probe)
    return size if parameter.lower <= size <= parameter.upper else float("nan")


def _factor(point: Point, felt: _Felt, probe: dict[str, float], size: EffectParameter) -> float:
    """The same in units of the probe, by regula falsi over the logarithms of size and score."""
    before = point.noise.departure(point.exact)

    def excess(power: float) -> float:
        value = min(float(np.exp(power)) * size.probe, size.upper)
        model = point.exact.add(felt.effect, {**probe, size.name: value}).with_substeps(SUBSTEPS)
        left = point.freed((point.noise.departure(model) - before)[None])
        return float(np.log(max(np.sum(left**2) / felt.level, 1e-30)))

    largest = 0.0 if felt.excess > 1.0 else min(WITHIN[1], float(np.log(size.upper / size.probe)))
    try:
        if excess(WITHIN[0]) > 0.0:
            return float(np.exp(WITHIN[0]))  # the smallest that is tried shows already
        return float(np.exp(brentq(excess, WITHIN[0], largest, xtol=0.01)))
    except (ValueError, ModelError, UnstableLoopError):
        return float("nan")  # the level is not reached within what physics allows


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of columns of whatever size."""
    norms = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns / np.where(norms > 0.0, norms, 1.0), full_matrices=False)
    return np.asarray(left[:, values > 1e-6 * values.max(initial=1e-300)])
