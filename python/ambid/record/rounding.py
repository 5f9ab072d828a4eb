"""Steps that the values of a channel are in: what the converter, or the digits of a file, left of them."""

import numpy as np

from ambid.arrays import FloatArray

EVEN = 0.1
"""Part of a step by which values may be off its multiples: factors and offsets are applied to what is converted."""
FEWEST = 64
"""Steps that a channel spans at least where they are those of a converter: a binary sequence has levels of its own."""


def step_of(x: FloatArray) -> float:
    """Step of the converter that a channel of shape (N,) came through; 0 where its values are not in steps."""
    apart = np.diff(np.unique(x))
    apart = apart[apart > 1e-9 * apart.max(initial=0.0)]
    if not len(apart):
        return 0.0
    step = float(apart.min())
    for most in (10.0, 1e3, np.inf):  # the last digits that were written count less in larger multiples
        own = apart[apart < most * step]
        step = float(own.sum() / np.rint(own / step).sum())
    return step if np.all(np.abs(apart / step - np.rint(apart / step)) < EVEN) else 0.0


def rounding_power(x: FloatArray) -> float:
    """Mean square of the error by rounding of a channel to its steps, q^2/12; 0 where it has none, or few levels."""
    step = step_of(x)
    return step**2 / 12.0 if step * FEWEST < np.ptp(x) else 0.0
