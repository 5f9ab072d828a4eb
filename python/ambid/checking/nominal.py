"""The nominal machine, controller and amplifier as responses, and the spectra that they are held against."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ambid.arrays import ComplexArray, FloatArray
from ambid.loop.assembly import Lft
from ambid.loop.controller import of_reference
from ambid.loop.geometry import rotor_of
from ambid.loop.mode import worst_mode
from ambid.loop.plant import base_plant
from ambid.loop.response import frequency_response
from ambid.model import Model
from ambid.noise.window import Window
from ambid.record import Record
from ambid.rig import Controller, Rig
from ambid.rig.controller import StateSpace

HIGHEST_FREQUENCY = 0.25
"""Lines up to this part of the sample rate count."""
BLURRED = 16
"""Lowest line that counts of a record without periods: below it are what drifts, and a window that blurs an integral's
1/f by more than a hundredth."""
CLEAR = 30.0
"""Power of an excited line over that of noise from which on it is clear of it."""
AROUND = 31
"""Unexcited lines that tell the power of noise at a line."""
MOST_LINES = 1000
"""Lines that an equation is held against, at most."""
SHORTEST_LAG = 0.01
"""Samples that a lag of the amplifier lasts at least, where it is fitted."""
GAIN_FACTORS = (1.0, 1.05, 0.95, 1.1, 0.9, 1.2, 0.8, 1.4, 0.7)
"""Common factors on all K_i that are tried, nearest first, where the nominal loop is unstable."""


@dataclass(frozen=True)
class Lines:
    """Spectra of one record on its excited lines, after the first period; over all of it where it has no periods.

    Attributes
    ----------
    frequency_hz : ndarray, shape (lines,)
    i_e, y : ndarray, shape (lines, axes)
        [A], [m], up to a common factor.
    i_c : ndarray, shape (lines, axes), or None
    r : ndarray, shape (lines, axes)
        Of the reference [m]; zero where there is none.
    index : ndarray, shape (lines,)
        Number of each line among those of `window` samples; the first is 1.
    window : int
        Samples of one period, or of the record without periods.
    whole_periods : bool
    clear : ndarray of bool, shape (lines,), or None
        Which of them y fills by far more than noise on every axis that moves; None where there are no periods to tell.
    quiet : Lines, or None
        Those that are not excited, of as many samples; None where there are no periods.
    are_responses : bool
        See `of_responses`.
    """

    frequency_hz: FloatArray
    i_e: ComplexArray
    y: ComplexArray
    i_c: ComplexArray | None
    r: ComplexArray
    index: NDArray[np.intp]
    window: int
    whole_periods: bool
    clear: NDArray[np.bool_] | None = None
    quiet: Lines | None = None
    are_responses: bool = False

    def some(self, kept: NDArray[np.bool_]) -> Lines:
        """Some of the lines."""
        i_c = None if self.i_c is None else self.i_c[kept]
        own = (self.frequency_hz[kept], self.i_e[kept], self.y[kept], i_c, self.r[kept], self.index[kept])
        return Lines(
            *own, self.window, self.whole_periods, None if self.clear is None else self.clear[kept], self.quiet
        )

    @classmethod
    def of(cls, record: Record) -> Lines:
        """Lines of a record with i_e; the strongest of what drives it where there are many."""
        window, length = None, record.samples
        if record.period is not None and record.periods >= 2:
            window, length = Window.of(record).settled, record.period

        def spectrum(signal: FloatArray) -> ComplexArray:
            if window is not None:
                return window.lines(signal)[window.excited]
            return np.fft.rfft((signal - signal.mean(axis=0)) * np.hanning(len(signal))[:, None], axis=0)[1:]

        i_e = spectrum(np.asarray(record.i_e))
        r = np.zeros_like(i_e) if record.r is None else spectrum(record.r)
        size = np.abs(i_e).max(initial=0.0) / (np.abs(r).max(initial=0.0) or 1.0)
        drives = np.hstack([i_e, (size or 1.0) * r])
        drives = drives[:, np.any(drives, axis=0)]
        index = np.arange(1, len(i_e) + 1)
        frequency = index * record.sample_rate / length
        power = np.linalg.norm(drives, axis=1)
        usable = (index >= (BLURRED if window is None else 1)) & (frequency < HIGHEST_FREQUENCY * record.sample_rate)
        kept = np.flatnonzero(usable & (power > 1e-3 * power.max(initial=0.0)))
        own = -(-MOST_LINES // max(1, drives.shape[1]))  # of every axis: each may be excited on lines of its own
        kept = np.unique(kept[np.argsort(np.abs(drives[kept]), axis=0)[-own:]])
        i_c = None if record.i_c is None else spectrum(record.i_c)[kept]
        y = spectrum(record.y)[kept]
        clear = None if window is None else _clear_of_noise(window, record.y, y, kept)
        quiet = None if window is None else cls._not_excited(record, window)
        return cls(frequency[kept], i_e[kept], y, i_c, r[kept], index[kept], length, window is not None, clear, quiet)

    @classmethod
    def of_responses(cls, record: Record) -> Lines:
        """What follows the excitation of a record without periods: a row a frequency and input that moves alone.

        What the record began with leaks into its spectra, but not into the local polynomials of its responses. Rows are
        divided by the std of y.

        Raises
        ------
        RecordError
            If the record is too short for them.
        """
        found, axes = record.frequency_response(), len(record.axes)
        low = found.frequency_hz < HIGHEST_FREQUENCY * record.sample_rate
        names = [f"{signal}.{axis}" for signal in ("i_e", "r") for axis in record.axes]
        drives = np.tile(np.eye(len(names), dtype=complex)[[names.index(own) for own in found.inputs]], (low.sum(), 1))
        of_pairs = found.response[low].swapaxes(1, 2).reshape(len(drives), -1)
        weight = 1.0 / np.linalg.norm(found.std[low, :axes], axis=1).reshape(-1, 1)
        h, drives = weight * of_pairs, weight * drives
        return cls(
            np.repeat(found.frequency_hz[low], len(found.inputs)),
            drives[:, :axes],
            h[:, :axes],
            None if record.i_c is None else h[:, axes:],
            drives[:, axes:],
            np.arange(1, len(h) + 1),
            record.samples,
            whole_periods=False,
            are_responses=True,
        )

    @classmethod
    def _not_excited(cls, record: Record, window: Window) -> Lines:
        """Those between the excited lines, up to as high a frequency."""
        index = window.between(1)
        frequency = index * record.sample_rate / window.samples
        kept = frequency < HIGHEST_FREQUENCY * record.sample_rate

        def spectrum(signal: FloatArray | None) -> ComplexArray:
            return window.lines(np.zeros_like(record.y) if signal is None else signal)[index][kept]

        i_c = None if record.i_c is None else spectrum(record.i_c)
        own = (spectrum(record.i_e), spectrum(record.y), i_c, spectrum(record.r))
        return cls(frequency[kept], *own, index[kept], window.samples, whole_periods=True)


def _clear_of_noise(
    window: Window, signal: FloatArray, excited: ComplexArray, kept: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Which excited lines stand above the unexcited ones around them, on every axis that moves."""
    between = window.between(1)
    noise = uniform_filter1d(np.abs(window.lines(signal)[between]) ** 2, AROUND, axis=0, mode="nearest")
    here = np.minimum(np.searchsorted(between, window.excited[kept]), len(between) - 1)
    return np.asarray((np.abs(excited) ** 2 > CLEAR * noise[here])[:, moves(excited)].all(axis=1))


class NominalLoop:
    """A rig's loop as frequency responses.

    Parameters
    ----------
    rig : Rig

    Attributes
    ----------
    gain_factor : float or None
        1 where the nominal loop is stable; else the nearest common factor on all K_i that makes it so; None if none
        does. K_i is taken with this factor in `closed` and `poles`, not in `machine`.
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
    def _open(self) -> Lft:
        """The plant with Delta open."""
        return base_plant(self.rig, self.rotor)

    @cached_property
    def open_poles(self) -> ComplexArray:
        """Poles with the controller off [1/s]."""
        return np.linalg.eigvals(self._plant(1.0)[0]).astype(np.complex128)

    def machine(self, frequency_hz: FloatArray) -> ComplexArray:
        """G, from the recorded i_c to y [m/A], shape (lines, axes, axes)."""
        return self._displacement(frequency_hz, 1.0) / self.amplifier(frequency_hz)[:, None, None]

    def amplifier(self, frequency_hz: FloatArray) -> ComplexArray:
        """A, the known first-order lag, of a voltage-driven coil over its nominal resistance, shape (lines,)."""
        amplifier = self.rig.amplifier
        lag = 1.0 + 2j * np.pi * frequency_hz * amplifier.time_constant
        return np.asarray(1.0 / (lag * (amplifier.resistance or 1.0)), np.complex128)

    def controller(self, frequency_hz: FloatArray) -> ComplexArray:
        """d K, from y to the current that the amplifier is asked for [A/m], shape (lines, axes, axes).

        A digital controller holds its output over a sample. One that reads i_c is closed over the amplifier.
        """
        own = self.rig.controller
        response = self.sampled(frequency_hz, own)
        if own.is_digital:
            path = _hold(frequency_hz, own.rate(self.rig.sample_rate)) * self._delay(frequency_hz)
            response = response * path[:, None, None]
        return self._beside_current(frequency_hz) @ response[:, :, self._columns("y")]

    def _beside_current(self, frequency_hz: FloatArray) -> ComplexArray:
        """What is left of a command by what the controller makes of the current, shape (lines, axes, axes)."""
        own, way = self.rig.controller, self.amplifier(frequency_hz)
        eye = np.eye(self.axes, dtype=complex)
        if "i_c" not in own.signals:
            return np.tile(eye, (len(frequency_hz), 1, 1))
        if own.is_digital:
            way = way * _hold(frequency_hz, own.rate(self.rig.sample_rate)) * self._delay(frequency_hz)
        by_current = self.sampled(frequency_hz, own)[:, :, self._columns("i_c")]
        return np.asarray(np.linalg.inv(eye + by_current * way[:, None, None]))

    def _columns(self, signal: str) -> slice:
        """Of a signal that the controller reads."""
        first = self.rig.controller.signals.index(signal) * self.axes
        return slice(first, first + self.axes)

    def sampled(self, frequency_hz: FloatArray, controller: Controller) -> ComplexArray:
        """K alone, of a digital controller from sample to sample, shape (lines, axes, signals that it reads)."""
        rate = self.rig.sample_rate
        system = controller.state_space(self.axes, rate)
        if not controller.is_digital:
            return frequency_response(system, 2j * np.pi * frequency_hz)
        return frequency_response(system, np.exp(2j * np.pi * frequency_hz / controller.rate(rate)))

    def paths(
        self, frequency_hz: FloatArray, *, more_delay: float = 0.0, more_lag: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """A d h, from samples of i_e to those of i_c, and A d, or A d h of a digital controller, from K y to them.

        What is held passes delay and amplifier with all its images, to first order exactly. Either may have
        `more_delay` and `more_lag` [s]; a current that is read late has a negative delay.
        """
        own, rate, amplifier = self.rig.controller, self.rig.sample_rate, self.rig.amplifier
        tau = amplifier.time_constant
        if tau > 0.0:
            tau = max(SHORTEST_LAG / rate, tau + more_lag)
        delay = own.delay_samples / own.rate(rate) + more_delay
        over = np.asarray(1.0 / (amplifier.resistance or 1.0), np.complex128)
        s = 2j * np.pi * frequency_hz
        more = (
            np.exp(-s * more_delay) if tau == 0.0 else 1.0
        )  # what an ideal amplifier holds has no slope to move along
        delay_held = delay if tau > 0.0 else delay - more_delay
        of_i_e = over * more * held_lag(frequency_hz, rate, tau, delay_held)
        if own.is_digital:
            return of_i_e, over * more * held_lag(frequency_hz, own.rate(rate), tau, delay_held)
        return of_i_e, np.asarray(over * np.exp(-s * delay) / (1.0 + s * tau))

    def excitation(self, frequency_hz: FloatArray) -> ComplexArray:
        """d h, from the samples of i_e to what the amplifier is asked for, shape (lines, axes, axes)."""
        path = self._delay(frequency_hz) * _hold(frequency_hz, self.rig.sample_rate)
        return np.asarray(self._beside_current(frequency_hz) * path[:, None, None])

    def driven(self, lines: Lines) -> ComplexArray:
        """i_e and what the controller makes of the reference, as one excitation, shape (lines, axes) [A]."""
        if not lines.r.any():
            return lines.i_e
        points = np.exp(2j * np.pi * lines.frequency_hz / self.rig.sample_rate)
        return np.asarray(lines.i_e + times(of_reference(self.rig, points), lines.r))

    def sensitivity(self, frequency_hz: FloatArray) -> ComplexArray:
        """(I + K G)^-1 with the stabilising `gain_factor`, shape (lines, axes, axes)."""
        loop_gain = self.controller(frequency_hz) @ self._displacement(frequency_hz, self.gain_factor or 1.0)
        return np.asarray(np.linalg.inv(np.eye(self.axes) + loop_gain), np.complex128)

    def closed(self, frequency_hz: FloatArray) -> ComplexArray:
        """From the samples of i_e to y [m/A], with the stabilising `gain_factor`, shape (lines, axes, axes)."""
        open_loop = self._displacement(frequency_hz, self.gain_factor or 1.0)
        return open_loop @ self.sensitivity(frequency_hz) @ self.excitation(frequency_hz)

    def _displacement(self, frequency_hz: FloatArray, gain_factor: float) -> ComplexArray:
        """From the commands i_ref to y."""
        return frequency_response(self._plant(gain_factor), 2j * np.pi * frequency_hz)

    def _plant(self, gain_factor: float) -> StateSpace:
        """A, B, C, D from i_ref to y, with the nominal values in Delta."""
        values = {slot: p.value for p in Model(self.rig).parameters for slot in p.slots}
        values |= {slot: gain_factor * value for slot, value in values.items() if slot.startswith("K_i.")}
        a, b, c, d = self._open.closed(values)
        return a, b[:, : self.axes], c[: self.axes], d[: self.axes, : self.axes]

    def _delay(self, frequency_hz: FloatArray) -> ComplexArray:
        own = self.rig.controller
        return np.exp(-2j * np.pi * frequency_hz * own.delay_samples / own.rate(self.rig.sample_rate))


def _hold(frequency_hz: FloatArray, rate: float) -> ComplexArray:
    """Zero-order hold over one sample."""
    return np.sinc(frequency_hz / rate) * np.exp(-1j * np.pi * frequency_hz / rate)


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


def times(response: ComplexArray, signal: ComplexArray) -> ComplexArray:
    """A response applied to a signal, line by line."""
    return (response @ signal[..., None])[..., 0]


def moves(columns: ComplexArray) -> NDArray[np.bool_]:
    """Which columns carry more than a few per cent of the strongest."""
    size = np.linalg.norm(columns, axis=0)
    return size > 0.03 * size.max()
