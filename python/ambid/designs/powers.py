"""The powers of lines that bring most information within limits, with a proof of how near they are to the best.

Information about the parameters and peaks of signals are linear in the powers of the lines. A sine of power w (half its
amplitude squared) on line l of axis j brings

    M_lj = n/2 Re(Psi^H Psi) w

of n samples, Psi being the whitened derivative of the response to a unit line.

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

from ambid.arrays import ComplexArray, FloatArray
from ambid.designs.peaks import Limits
from ambid.errors import InputError
from ambid.model import Model
from ambid.noise.colour import back_through_loop
from ambid.noise.foreseen import Instruments
from ambid.noise.whitener import Spectrum

HIGHEST = 0.4
"""Part of the sample rate up to which lines are excited; above, filters of converters bend what is played."""
NEAR = 0.99
"""Efficiency that is proven at the end: a hundredth in variance is half a per cent of an interval."""


@dataclass(frozen=True, eq=False)
class PoweredLines:
    """What each line may bring and what it costs.

    Attributes
    ----------
    lines : ndarray of int, shape (L,)
        In cycles per period, rising; line k belongs to axis k modulo the number of axes.
    information : ndarray, shape (L, q, q)
        About the relative parameters, per sample and unit of power.
    costs : ndarray, shape (L, signals)
        Power of every limited signal over the square of its limit, per unit of power.
    answers : dict of str to ndarray, shape (L,)
        Response of i_e, y and i_c of a line's own axis to it.
    """

    lines: np.ndarray
    information: FloatArray
    costs: FloatArray
    answers: dict[str, ComplexArray]

    @classmethod
    def of(
        cls, model: Model, period: int, instruments: Instruments, limits: Limits, free: list[int], scale: FloatArray
    ) -> PoweredLines:
        """All lines of a period up to `HIGHEST`, shared out between the axes.

        Parameters
        ----------
        model : Model
            Linear.
        period : int
            Samples.
        instruments : Instruments
        limits : Limits
        free : list of int
            Parameters that count.
        scale : ndarray, shape (free,)
            What they are relative to.
        """
        model = instruments.of_model(model)
        rig, p, axes = model.rig, instruments.channels, len(model.rig.axes)
        at = {name: [model.loop.outputs.index(f"{name}.{axis}") for axis in rig.axes] for name in ("y", "i_c")}
        lines = np.arange(1, 1 + min((period - 1) // 2, int(HIGHEST * period)))
        points = np.exp(2j * np.pi * lines / period)
        inputs = np.zeros((len(lines), model.loop.core.inputs), dtype=complex)
        inputs[np.arange(len(lines)), np.arange(len(lines)) % axes] = 1.0
        response, slopes, _ = model.loop.core.lines(model.theta, free, points, inputs, None, False)
        covariance = instruments.at(lines * rig.sample_rate / period)
        whitening = Spectrum.of(covariance, back_through_loop(model, points, p), np.ones(len(lines))).whitening
        white = whitening @ slopes[:, :p] * scale
        information = 0.5 * np.real(white.conj().transpose(0, 2, 1) @ white)
        count, own = np.arange(len(lines)), np.arange(len(lines)) % axes
        limited = {"i_e": inputs[:, :axes], **{name: response[:, columns] for name, columns in at.items()}}
        answers = {name: values[count, own] for name, values in limited.items()}
        return cls(lines, information, _costs(limited, points, limits, model), answers)


def _costs(signals: dict[str, ComplexArray], points: ComplexArray, limits: Limits, model: Model) -> FloatArray:
    """Power of every limited signal, shape (L, axes) each, over its limit squared, shape (L, signals)."""
    slope = signals["i_c"] * (points - 1.0)[:, None] * model.rig.sample_rate
    allowed = limits.of(model.rig)
    return np.hstack([np.abs((signals | {"slope": slope})[name]) ** 2 / own**2 for name, own in allowed.items()])


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
    for count in range(1, 4001):  # a thousand rounds are some tenths of a second
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
