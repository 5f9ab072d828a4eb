"""Steps that the values of a channel are in: what the converter, or the digits of a file, left of them."""

import numpy as np

from ambid.arrays import FloatArray

LOOKED_AT = 4096
"""Samples of a channel that are looked at for the step of its converter."""
EVEN = 0.02
"""Part of a step by which values may be off its multiples: factors and offsets are applied to what is converted."""
FEWEST = 64
"""Steps that a channel spans at least where they are those of a converter: a binary sequence has levels of its own."""


def step_of(x: FloatArray) -> float:
    """Step of the converter that a channel of shape (N,) came through; 0 where its values are not in steps."""
    few = np.unique(x[:: 1 + len(x) // LOOKED_AT])
    apart = np.diff(few)
    if not len(apart) or len(few) > 0.9 * min(len(x), LOOKED_AT):
        return 0.0
    step = float(apart[apart > 1e-9 * apart.max()].min())
    counts = apart / step
    return step if np.abs(counts - np.rint(counts)).max() < EVEN * max(1.0, float(counts.max()) ** 0.5) else 0.0


def rounding_power(x: FloatArray) -> float:
    """Mean square of the error by rounding of a channel to its steps, q^2/12; 0 where it has none, or few levels."""
    step = step_of(x)
    return step**2 / 12.0 if step * FEWEST < np.ptp(x) else 0.0
