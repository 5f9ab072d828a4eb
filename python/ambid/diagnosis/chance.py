"""How likely chance alone reaches a score."""

from __future__ import annotations

import numpy as np
from scipy.special import comb

from ambid.arrays import ComplexArray, FloatArray
from ambid.noise.chance import log_chance


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
