"""What is known of values of the rig file beforehand, as further numbers beside those that were measured.

A value that is known to a tolerance is a measurement of its own: its error d from the rig file, of standard deviation
s, adds the whitened number ``0 - d/s`` to the residual, and to J the square of it. A fit that moves d with the other
parameters minimises ``J = r'r + sum (d/s)^2``, which is the maximum a posteriori; with the response linear in d, J
there is that of a residual whose covariance ``I + psi s^2 psi'`` the errors are part of: they are marginalised.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.arrays import FloatArray
from ambid.model import Model

__all__ = ["known_residual", "known_slopes", "known_weights"]


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
