"""What transients can look like on lines: orthonormal bases, and what is free from them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from ambid.arrays import FloatArray

__all__ = ["OWN", "freed", "orthonormal"]

OWN = 1e-10
"""Part of the largest eigenvalue of the transient's Gram matrix below which a direction of it says nothing."""


def orthonormal(basis: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns, without directions that are nearly those of others."""
    if not basis.shape[1]:
        return basis
    size = np.linalg.norm(basis, axis=0)
    scaled = basis[:, size > 0.0] / size[size > 0.0]
    values, vectors = eigh(scaled.T @ scaled)
    kept = values > OWN * values.max(initial=0.0)
    return np.asarray(scaled @ (vectors[:, kept] / np.sqrt(values[kept])))


def freed(signal: FloatArray, basis: FloatArray) -> FloatArray:
    """What an orthonormal basis cannot take over."""
    return np.asarray(signal - basis @ (basis.T @ signal))
