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
