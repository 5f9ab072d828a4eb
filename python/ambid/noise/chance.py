"""What chance alone brings."""

import numpy as np
from scipy.special import chdtrc, chdtri, comb, gammaln

from ambid.arrays import ComplexArray, FloatArray

ADEQUATE = 1.10
"""Largest misfit J/dof of a model that is called adequate, if chance does not bring more on a short record."""

SPREAD = 1.5
"""Standard deviation of J in units of sqrt(2 dof): the noise spectrum is estimated too.

With m unexcited lines to each excited one, it is sqrt(1 + 1/m): 1.41 for two periods."""
RESPONSE_SPREAD = 2.5
"""The same of a frequency response: its covariance is estimated from fewer lines, shared by neighbouring frequencies.

Of 60 responses made from records, with a right model, J/dof lies on average 1.4 % above 1, and its root mean square
about 1 is 0.024, of some 21 750 degrees of freedom."""
RARE = 1e-3
"""Chance that the misfit of a right model is above its bound, and that any other test fails it."""
UNUSUAL = 1e-4
"""Chance of noise below which it is taken for something else: for uneven, for a parameter that changes, or, on a line,
for what a model misses."""
CERTAIN = 1e-4
"""Minus the log of a chance that is as good as one."""


def misfit_bound(dof: float, chance: float = RARE, spread: float = SPREAD) -> float:
    """J/dof that the right model exceeds with so small a chance: of chi-squared with dof / spread^2 degrees."""
    own = dof / spread**2
    return float(chdtri(own, chance) / own)


def log_chance(fall: float, degrees: int) -> float:
    """Logarithm of the chance that chi-squared reaches a value."""
    known = float(chdtrc(degrees, fall))
    if known > 0.0:
        return float(np.log(known))
    half, shape = fall / 2.0, degrees / 2.0
    return float((shape - 1.0) * np.log(half) - half - gammaln(shape))


def log_odds_against(log_p: float) -> float:
    """Log of the odds against noise of what it brings so rarely, at the most (Sellke, Am. Stat. 55 (2001) 62)."""
    return max(0.0, -1.0 - log_p - float(np.log(-log_p))) if log_p < -1.0 else 0.0


def log_mean_odds_against(log_p: float) -> float:
    """The same, no bound but a mean: noise alone brings odds of one on average, however many are multiplied.

    ``(1 - p + p log p) / (p log^2 p)`` (Vovk and Wang, Ann. Stat. 49 (2021) 1736).
    """
    if log_p > -CERTAIN:
        return -float(np.log(2.0))
    p = np.exp(log_p)
    return float(np.log(1.0 - p + p * log_p) - log_p - 2.0 * np.log(-log_p))


def log_chance_bounded(fall: float, degrees: int, one_sided: int) -> float:
    """The same where so many of the amplitudes may only be positive: each is at its bound in half of all records."""
    if fall <= 0.0:
        return 0.0
    one_sided = min(one_sided, degrees)
    free = degrees - one_sided
    ways = comb(one_sided, np.arange(one_sided + 1)) / 2.0**one_sided
    chances = [log_chance(fall, free + k) if free + k else -np.inf for k in range(one_sided + 1)]
    return float(np.logaddexp.reduce(chances + np.log(ways)))


def independent_tests(correlation: FloatArray | ComplexArray, subspaces: int) -> float:
    """How many independent tests the best of some subspaces is, from the eigenvalues of their correlation.

    Galwey, Genetic Epidemiology 33 (2009) 559: ``(sum sqrt(lambda))^2 / sum lambda``, here over the mean dimension.

    Parameters
    ----------
    correlation : ndarray, shape (directions, directions)
        Inner products of orthonormal bases of all subspaces, side by side.
    subspaces : int
    """
    roots = np.sqrt(np.maximum(np.linalg.eigvalsh(correlation), 0.0))
    count = roots.sum() ** 2 / np.sum(roots**2) * subspaces / len(correlation)
    return float(np.clip(count, 1.0, subspaces))
