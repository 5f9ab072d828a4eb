"""Information about the parameters, and peaks of signals, per line and power of the excitation.

Both are linear in the powers of the lines. A sine of power w (half its amplitude squared) on line l of axis j brings

    M_lj = n/2 Re(Psi^H Psi) w

of n samples, Psi being the whitened derivative of the response to a unit line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.designs.peaks import Limits
from ambid.model import Model
from ambid.noise.colour import back_through_loop
from ambid.noise.foreseen import Instruments
from ambid.noise.whitener import Spectrum

__all__ = ["PoweredLines"]


HIGHEST = 0.4
"""Part of the sample rate up to which lines are excited; above, filters of converters bend what is played."""


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
        currents = [model.loop.outputs.index(f"i_c.{axis}") for axis in rig.axes]
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
        answers = {"i_e": inputs[count, own], "y": response[count, own], "i_c": response[count, np.take(currents, own)]}
        usual = response[:, [*range(axes), *currents]]
        return cls(lines, information, _costs(inputs, usual, points, limits, model), answers)


def _costs(
    inputs: ComplexArray, response: ComplexArray, points: ComplexArray, limits: Limits, model: Model
) -> FloatArray:
    """Power of every limited signal over its limit squared, shape (L, signals)."""
    axes = len(model.rig.axes)
    y, i_c = response[:, :axes], response[:, axes : 2 * axes]
    slope = i_c * (points - 1.0)[:, None] * model.rig.sample_rate
    signals = {"i_e": inputs[:, :axes], "y": y, "i_c": i_c, "slope": slope}
    allowed = limits.of(model.rig)
    return np.hstack([np.abs(signals[name]) ** 2 / own**2 for name, own in allowed.items()])
