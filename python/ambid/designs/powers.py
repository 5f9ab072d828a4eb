"""The powers of lines that bring most information within limits, with a proof of how near they are to the best.

Powers w bring the information M = sum w_l M_l and load each limited signal s by P_s = sum w_l P_ls, which may be 1 at
the most. The criterion is the volume of the confidence region (D: log det M), or a mean of variances
(A: tr C M^-1); both are convex problems. With d_l = tr(M^-1 M_l), or tr(M^-1 C M^-1 M_l), its sum t = sum w_l d_l, and
any weights mu_s of the signals, whose sum is 1, no other powers are better than by the factor

    1 / efficiency = max over l of d_l / (t sum_s mu_s P_ls)

in all variances: of D since log det M* - log det M <= q log(tr(M^-1 M*) / q), and sum w*_l sum_s mu_s P_ls <= 1
(Kiefer and Wolfowitz 1960, with several limits). The powers grow by the same ratio, d_l over their cost, until it is
1 wherever there is power (the multiplicative algorithm; Silvey, Titterington and Torsney 1978), and the weights by the
load of their signals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambid.arrays import FloatArray
from ambid.designs.lines import PoweredLines
from ambid.errors import InputError

__all__ = ["Powers", "best_powers", "criterion"]

ROUNDS = 4000
"""Rounds at the most; a thousand are some tenths of a second."""
NEAR = 0.99
"""Efficiency that is proven at the end: a hundredth in variance is half a per cent of an interval."""


@dataclass(frozen=True, eq=False)
class Powers:
    """Powers of lines.

    Attributes
    ----------
    powers : ndarray, shape (L,)
        Where the largest load is 1.
    efficiency : float
        Proven part of the best criterion with as much power: variances are at the most so much larger.
    on_the_way : tuple of ndarray
        Powers between flat ones and these.
    """

    powers: FloatArray
    efficiency: float
    on_the_way: tuple[FloatArray, ...]


def criterion(information: FloatArray, wanted: FloatArray | None) -> float:
    """What is to be small: the mean variance of D, det(M)^(-1/q), or tr(C M^-1) where C is wanted."""
    sign, volume = np.linalg.slogdet(information)
    if sign <= 0.0:
        return float("inf")
    if wanted is None:
        return float(np.exp(-volume / len(information)))
    return float(np.trace(np.linalg.solve(information, wanted)))


def best_powers(of: PoweredLines, wanted: FloatArray | None = None) -> Powers:
    """Find the powers that bring most information.

    Parameters
    ----------
    of : PoweredLines
    wanted : ndarray, shape (q, q), optional
        C of the A-criterion; by default D.

    Raises
    ------
    InputError
        If no powers determine all parameters.
    """
    q = of.information.shape[1]
    rows, signals = of.information.reshape(-1, q * q), of.costs
    weights = np.full(signals.shape[1], 1.0 / signals.shape[1])
    powers = 1.0 / (signals @ weights)
    powers /= (powers @ signals).max()
    kept, efficiency, best = [powers], 0.0, powers
    following = 1.0
    for count in range(1, ROUNDS + 1):
        information = (powers @ rows).reshape(q, q)
        if np.linalg.cond(information) > 1e14:
            raise InputError(
                "no excitation of these axes determines all parameters; fix some, record i_c, or excite every axis"
            )
        inverse = np.linalg.inv(information)
        inner = inverse if wanted is None else inverse @ wanted @ inverse
        gain = rows @ inner.ravel()
        total = float(powers @ gain)
        ratio = gain / (total * (signals @ weights))
        if 1.0 / ratio.max() > efficiency:
            efficiency, best = 1.0 / float(ratio.max()), powers
        if efficiency >= NEAR:
            break
        powers = powers * (ratio if wanted is None else np.sqrt(ratio))
        load = powers @ signals
        powers = powers / load.max()
        # power of its load by which the weight of a signal grows in a round; with more it swings
        weights = weights * (load / load.max()) ** 0.2
        weights /= weights.sum()
        if count >= following:
            kept.append(powers)
            following *= 2.0  # factor in rounds between powers that are kept on the way
    return Powers(best, efficiency, tuple(kept))
