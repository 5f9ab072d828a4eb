"""What is known of values of the rig file beforehand, as further numbers beside those that were measured.

A value that is known to a tolerance is a measurement of its own: its error d from the rig file, of standard deviation
s, adds the whitened number ``0 - d/s`` to the residual, and to J the square of it. A fit that moves d with the other
parameters minimises ``J = r'r + sum (d/s)^2``, which is the maximum a posteriori; with the response linear in d, J
there is that of a residual whose covariance ``I + psi s^2 psi'`` the errors are part of: they are marginalised.

Where a model leaves more than noise, what is left is no evidence of so many errors of the rig file: it is smooth over
bands of lines, so that N numbers are only W witnesses of it, and its size is fitted beside the parameters. Where
``r'r > N``, ``N + W ln V + sum (d/s)^2`` with ``V = 1 + (r'r - N)/W`` takes the place of J; it has the gradient of
``r'r/V``.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.model import Model


def known_residual(model: Model) -> FloatArray:
    """Whitened rig file minus model, a number for each value that is known to a tolerance, shape (k,)."""
    return np.array([-p.value / p.prior for p in model.parameters if p.prior is not None])


def known_slopes(model: Model, free: Sequence[int]) -> FloatArray:
    """Whitened derivatives of the same values by the parameters in `free`, shape (k, free)."""
    own = [(i, p.prior) for i, p in enumerate(model.parameters) if p.prior is not None]
    return np.array([[1.0 / std if i == j else 0.0 for j in free] for i, std in own]).reshape(len(own), len(free))


def known_weights(model: Model, free: Sequence[int]) -> FloatArray:
    """One over the variance to which each parameter in `free` is known beforehand, 0 of one that is not, (free,)."""
    stds = [model.parameters[i].prior for i in free]
    return np.array([0.0 if std is None else std**-2 for std in stds])


BANDS = 40
"""Bands of lines of each record that count as independent where misfit is left."""


class Size(NamedTuple):
    """Judged numbers, and how many of them count as independent where more than noise is left; none: not asked for."""

    numbers: float = 0.0
    witnesses: float = 0.0

    def variance(self, measured: float) -> float:
        """V of a sum of squares."""
        excess = measured - self.numbers
        return 1.0 + excess / self.witnesses if excess > 0.0 and self.witnesses > 0.0 else 1.0


def tempered_cost(cost: float, weights: FloatArray, theta: FloatArray, size: Size) -> tuple[float, float]:
    """V of what is left, and r'r with it, in which each of the parameters `theta` is known with a weight."""
    known = float(weights @ theta**2)
    left = size.variance(cost - known)
    return left, cost if left == 1.0 else size.numbers + size.witnesses * float(np.log(left)) + known


def tempered(
    hessian: FloatArray, gradient: FloatArray, cost: float, weights: FloatArray, theta: FloatArray, size: Size
) -> tuple[FloatArray, FloatArray, float]:
    """J'J, J'r and r'r, in which each of the parameters `theta` is known with a weight, with V of what is left."""
    left, cost = tempered_cost(cost, weights, theta, size)
    rest = (1.0 - 1.0 / left) * weights
    return hessian / left + np.diag(rest), gradient / left + rest * theta, cost
