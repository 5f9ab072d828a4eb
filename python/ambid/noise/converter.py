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
from ambid.record.rounding import step_of

__all__ = ["repeated_rounding"]

BITS = 16
"""Of the converters of measuring cards; the better ones have noise of their own above that."""


def repeated_rounding(x: FloatArray, power: float) -> float:
    """Mean square of the rounding error of a channel that repeats with its signal.

    Parameters
    ----------
    x : ndarray, shape (N,)
    power : float
        Of its noise as recorded, mean square.
    """
    step = max(step_of(x), float(np.ptp(x)) / 2**BITS)
    relative = power / step**2

    def excess(before: float) -> float:
        """Noise before the converter and what of its rounding does not repeat, less what the record has."""
        return before + (1.0 - _repeated_share(before)) / 12.0 - relative

    before = float(brentq(excess, 0.0, relative)) if np.isfinite(relative) and relative > 0.0 else relative
    return _repeated_share(before) * step**2 / 12.0


def _repeated_share(before: float) -> float:
    """rho for noise of this power before the converter, in squares of its step."""
    k = np.arange(1, 50)
    return 6.0 / np.pi**2 * float(np.sum(np.exp(-4.0 * np.pi**2 * k**2 * before) / k**2)) if before > 0.0 else 1.0
