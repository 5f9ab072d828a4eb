"""What the converters of a record round: noise that repeats with the signal, so that no unexcited line shows it.

A value rounded to steps q is off by an error of power q^2/12. Noise of deviation sigma before the converter makes most
of that error different in every period; the part that repeats is

    rho(sigma/q) = 6/pi^2 sum over k of exp(-4 pi^2 k^2 sigma^2/q^2) / k^2

(Widrow, Kollar, Quantization Noise, 2008, chapters 5 and 6), which beyond sigma = 0.4 q is nothing. No record is taken
to be finer than `BITS` of what it spans: there a simulated one without noise has its floor.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from ambid.arrays import FloatArray

__all__ = ["repeated_rounding", "step_of"]

BITS = 16
"""Of the converters of measuring cards; the better ones have noise of their own above that."""
LOOKED_AT = 4096
"""Samples of a channel that are looked at for the step of its converter."""
EVEN = 0.02
"""Part of a step by which values may be off its multiples: factors and offsets are applied to what is converted."""


def step_of(x: FloatArray) -> float:
    """Step of the converter that a channel of shape (N,) came through; 0 where its values are not in steps."""
    few = np.unique(x[:: 1 + len(x) // LOOKED_AT])
    apart = np.diff(few)
    if not len(apart) or len(few) > 0.9 * min(len(x), LOOKED_AT):
        return 0.0
    step = float(apart[apart > 1e-9 * apart.max()].min())
    counts = apart / step
    return step if np.abs(counts - np.rint(counts)).max() < EVEN * max(1.0, float(counts.max()) ** 0.5) else 0.0


def repeated_rounding(x: FloatArray, power: float) -> float:
    """Mean square of the rounding error of a channel that repeats with its signal.

    Parameters
    ----------
    x : ndarray, shape (N,)
    power : float
        Of its noise as recorded, mean square.
    """
    step = max(step_of(x), float(np.ptp(x)) / 2**BITS)
    told = power / step**2

    def excess(before: float) -> float:
        """Noise before the converter and what of its rounding does not repeat, less what the record has."""
        return before + (1.0 - _repeated_share(before)) / 12.0 - told

    before = float(brentq(excess, 0.0, told)) if np.isfinite(told) and told > 0.0 else told
    return _repeated_share(before) * step**2 / 12.0


def _repeated_share(before: float) -> float:
    """rho for noise of this power before the converter, in squares of its step."""
    k = np.arange(1, 50)
    return 6.0 / np.pi**2 * float(np.sum(np.exp(-4.0 * np.pi**2 * k**2 * before) / k**2)) if before > 0.0 else 1.0
