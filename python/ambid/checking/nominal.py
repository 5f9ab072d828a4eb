"""The rig's loop at its nominal values as responses on lines: closed, with its controller off, and the way to i_c."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.checking.lines import Lines, times
from ambid.effects.slips import ControllerGainError
from ambid.loop.controller import Reading, of_reference
from ambid.loop.geometry import rotor_of
from ambid.loop.loop import open_plant
from ambid.loop.mode import worst_mode
from ambid.loop.response import frequency_response
from ambid.model import Model
from ambid.rig import Rig

SHORTEST_LAG = 0.01
"""Samples that a lag of the amplifier lasts at least, where it is fitted."""
GAIN_FACTORS = (1.0, 1.05, 0.95, 1.1, 0.9, 1.2, 0.8, 1.4, 0.7)
"""Common factors on all K_i that are tried, nearest first, where the nominal loop is unstable."""


class NominalLoop:
    """A rig's loop at its nominal values, closed, and with its controller off.

    Parameters
    ----------
    rig : Rig

    Attributes
    ----------
    gain_factor : float or None
        1 where the nominal loop is stable; else the nearest common factor on all K_i that makes it so; None if none
        does. K_i is taken with this factor in `model` and `poles`, not in `machine`.
    model : Model
        With `gain_factor`.
    nominal_poles, poles : ndarray
        Of the nominal closed loop, and of the one with `gain_factor` [1/s], slowest first.
    worst_mode : tuple of (int, float)
        Bending mode that the slowest of the nominal poles moves, 0 of a rigid body, and its frequency at rest [Hz].
    """

    def __init__(self, rig: Rig) -> None:
        self.rig, self.axes = rig, len(rig.axes)
        self.rotor = rotor_of(rig)
        nominal = Model(rig)
        self.nominal_poles = nominal.poles()
        self.worst_mode = worst_mode(nominal.loop.state_space(nominal.theta)[0], self.rotor)
        self.gain_factor: float | None = None
        self.model, self.poles = nominal, self.nominal_poles
        for factor in GAIN_FACTORS:
            values = {p.name: factor * p.value for p in nominal.parameters if p.name.startswith("K_i.")}
            model = nominal.with_values(values)
            poles = model.poles()
            if poles.real.max() < 0.0:
                self.gain_factor, self.model, self.poles = factor, model, poles
                break

    @cached_property
    def open_poles(self) -> ComplexArray:
        """Poles of the plant without a controller [1/s]."""
        nominal = {slot: p.value for p in Model(self.rig).parameters for slot in p.slots}
        return np.linalg.eigvals(open_plant(self.rig, ()).closed(nominal)[0]).astype(np.complex128)

    def closed(self, frequency_hz: FloatArray) -> ComplexArray:
        """From the samples of i_e, and r, to those of y and i_c, with `gain_factor`, shape (lines, 2 axes, inputs)."""
        return _sampled(self.model, self.model.theta, frequency_hz)

    def machine(self, frequency_hz: FloatArray) -> ComplexArray:
        """G, from the recorded i_c to y [m/A], shape (lines, axes, axes): both as the loop has them of i_e, K off."""
        off = Model(self.rig).add(ControllerGainError())
        theta = np.where([name.startswith(ControllerGainError.name) for name in off.names], -1.0, off.theta)
        of_i_e = _sampled(off, theta, frequency_hz)[:, :, : self.axes]
        return of_i_e[:, : self.axes] / np.einsum("ljj->lj", of_i_e[:, self.axes :])[:, None, :]

    def answered(self, lines: Lines) -> Lines:
        """Spectra as the closed loop makes them of the excitation."""
        drives = np.hstack([lines.i_e, lines.r]) if self.rig.controller.follows_reference else lines.i_e
        both = times(self.closed(lines.frequency_hz), drives)
        return replace(lines, y=both[:, : self.axes], i_c=both[:, self.axes :])

    def law(self, frequency_hz: FloatArray) -> dict[str, ComplexArray]:
        """What each gain of K, ``K`` where only the whole is one, makes of y, i_c and r: (lines, axes, 3 axes) each.

        Of a digital controller from sample to sample.
        """
        own, rate = self.rig.controller, self.rig.sample_rate
        a, b, *_ = own.state_space(self.axes, rate)
        c, d = map(np.vstack, zip(*(own.part_of(gain, self.axes, rate) for gain in own.gains), strict=True))
        s = 2j * np.pi * frequency_hz
        of_read = frequency_response((a, b, c, d), np.exp(s / own.rate(rate)) if own.is_digital else s)
        y, i_c, r = ([f"{signal}.{axis}" for axis in self.rig.axes] for signal in ("y", "i_c", "r"))
        reading = Reading.of(self.rig, y + i_c, r)
        response = of_read @ np.hstack([reading.outputs, reading.inputs])
        parts = np.moveaxis(response.reshape(len(s), len(own.gains), self.axes, response.shape[2]), 1, 0)
        return {"K" if gain == "gain" else gain: part for gain, part in zip(own.gains, parts, strict=True)}

    def paths(
        self, frequency_hz: FloatArray, *, more_delay: float = 0.0, more_lag: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """A d h, from samples of i_e to those of i_c, and A d, or A d h of a digital controller, from K y to them.

        What is held passes delay and amplifier with all its images, to first order exactly. Either may have
        `more_delay` and `more_lag` [s]; a current that is read late has a negative delay.
        """
        own, rate, amplifier = self.rig.controller, self.rig.sample_rate, self.rig.amplifier
        tau, delay, s = amplifier.time_constant, own.delay_samples / own.rate(rate), 2j * np.pi * frequency_hz
        over = np.full(len(s), 1.0 / (amplifier.resistance or 1.0), np.complex128)
        if tau > 0.0:
            tau, delay = max(SHORTEST_LAG / rate, tau + more_lag), delay + more_delay
        else:
            over *= np.exp(-s * more_delay)  # what an ideal amplifier holds has no slope to move along
        of_i_e = over * held_lag(frequency_hz, rate, tau, delay)
        if own.is_digital:
            return of_i_e, over * held_lag(frequency_hz, own.rate(rate), tau, delay)
        return of_i_e, np.asarray(over * np.exp(-s * delay) / (1.0 + s * tau))

    def driven(self, lines: Lines) -> ComplexArray:
        """i_e and what the controller makes of the reference, as one excitation, shape (lines, axes) [A]."""
        if not lines.r.any():
            return lines.i_e
        points = np.exp(2j * np.pi * lines.frequency_hz / self.rig.sample_rate)
        return np.asarray(lines.i_e + times(of_reference(self.rig, points), lines.r))


def _sampled(model: Model, theta: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """From held inputs to samples of the outputs, of a loop that may be unstable."""
    points = np.exp(2j * np.pi * frequency_hz / model.rig.sample_rate)
    return frequency_response(model.loop.state_space(theta), points)


def held_lag(frequency_hz: FloatArray, rate: float, tau: float, delay: float) -> ComplexArray:
    """From samples that are held, delayed by [s], to samples of what a first-order lag makes of them; exact.

    The step response 1 - exp(-t/tau) sampled at k/rate - delay, differenced: ``z^-l (g z^-1 + e (1 - a) z^-2 / (1 - a
    z^-1))`` with l whole samples of delay, a = exp(-1/(rate tau)), e = exp(-(1 - rest)/(rate tau)), g = 1 - e.
    """
    back = np.exp(-2j * np.pi * frequency_hz / rate)
    if tau == 0.0:
        return np.asarray(back ** np.ceil(delay * rate - 1e-9))
    whole = np.floor(delay * rate + 1e-9)
    a, e = np.exp(-1.0 / (rate * tau)), np.exp(-(1.0 - max(0.0, delay * rate - whole)) / (rate * tau))
    return np.asarray(back**whole * ((1.0 - e) * back + e * (1.0 - a) * back**2 / (1.0 - a * back)))
