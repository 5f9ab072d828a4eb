"""The two equations of a record, line by line: current from excitation and displacement, displacement from current.

    i_c = A d (h i_e - K (y - r))    the controller's, which needs no rotor
    y   = G i_c                      the machine's, which needs no controller

with the amplifier A, the controller K, its delay d, the hold h of the excitation, and the plant G. Each is held against
the record by itself, so that what is wrong shows on its own side; both stay valid where the nominal loop is unstable.
What lies above the Nyquist frequency is neglected, which costs a per cent or two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import linear_sum_assignment

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.loop.assembly import Lft
from ambid.loop.controller import of_reference
from ambid.loop.geometry import rotor_of
from ambid.loop.mode import moved_by_worst
from ambid.loop.plant import base_plant
from ambid.loop.response import frequency_response
from ambid.model import Model
from ambid.noise.window import Window
from ambid.record import Record
from ambid.rig import Controller, PidController, Rig
from ambid.rig.controller import PID_GAINS, StateSpace

HIGHEST_FREQUENCY = 0.25
"""Lines up to this part of the sample rate count."""
BLURRED = 16
"""Lowest line that counts of a record without periods: below it are what drifts, and a window that blurs an integral's
1/f by more than a hundredth."""
CLEAR = 30.0
"""Power of an excited line over that of noise from which on it is clear of it."""
AROUND = 31
"""Unexcited lines that tell the power of noise at a line."""
FEWEST_LINES = 8
"""Complex values for the up to 15 real unknowns of a controller's equation."""
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

    def some(self, kept: NDArray[np.bool_]) -> Lines:
        """Some of the lines."""
        i_c = None if self.i_c is None else self.i_c[kept]
        own = (self.frequency_hz[kept], self.i_e[kept], self.y[kept], i_c, self.r[kept], self.index[kept])
        return Lines(*own, self.window, self.whole_periods, None if self.clear is None else self.clear[kept])

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
        return cls(frequency[kept], i_e[kept], y, i_c, r[kept], index[kept], length, window is not None, clear)


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
    moved_by_worst : str
        What the slowest of the nominal poles moves.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig, self.axes = rig, len(rig.axes)
        self.rotor = rotor_of(rig)
        nominal = Model(rig)
        self.nominal_poles = nominal.poles()
        self.moved_by_worst = moved_by_worst(nominal.loop.state_space(nominal.theta)[0], self.rotor)
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
        return np.asarray(lines.i_e + _times(of_reference(self.rig, points), lines.r))

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


def commanded(loop: NominalLoop, lines: Lines) -> dict[str, ComplexArray]:
    """What every gain of the controller makes of what it reads, before delay, hold and amplifier, (lines, axes) [A]."""
    own = loop.rig.controller
    read = {"y": lines.y - lines.r if own.reference else lines.y, "i_c": lines.i_c, "r": lines.r}
    if "i_c" in own.signals and lines.i_c is None:
        raise RecordError("the controller reads i_c, which was not recorded; record it too")
    seen = np.hstack([columns for signal in own.signals if (columns := read[signal]) is not None])
    parts: dict[str, Controller] = {"K": own}
    if isinstance(own, PidController):
        off = dict.fromkeys(PID_GAINS, 0.0)
        parts = {g: own.model_copy(update={**off, g: getattr(own, g)}) for g in own.gains}
    return {name: _times(loop.sampled(lines.frequency_hz, part), seen) for name, part in parts.items()}


def controller_terms(loop: NominalLoop, lines: Lines) -> tuple[ComplexArray, dict[str, ComplexArray]]:
    """A d h i_e, and A d K y of every gain of the controller, each (lines, axes) [A]."""
    of_i_e, of_y = loop.paths(lines.frequency_hz)
    fed_back = {name: of_y[:, None] * own for name, own in commanded(loop, lines).items()}
    return of_i_e[:, None] * lines.i_e, fed_back


def controller_missed(loop: NominalLoop, lines: Lines) -> float:
    """Part of i_c, by rms over all axes, that the controller's equation misses as it stands."""
    excited, fed_back = controller_terms(loop, lines)
    i_c = np.asarray(lines.i_c)
    return float(np.linalg.norm(excited - sum(fed_back.values()) - i_c) / np.linalg.norm(i_c))


def reordered(loop: NominalLoop, lines: Lines) -> tuple[str, list[int], float]:
    """The order of the columns of one signal that fits the controller's equation best.

    Returns
    -------
    signal : str
        i_e, y or i_c.
    order : list of int
        Column to be taken for each axis.
    missed : float
        Part of i_c that is then missed.
    """
    excited, fed_back = controller_terms(loop, lines)
    own_gain = np.einsum("ljj->lj", loop.controller(lines.frequency_hz)) * loop.amplifier(lines.frequency_hz)[:, None]
    i_c = np.asarray(lines.i_c)
    left = excited - sum(fed_back.values()) - i_c
    ways = {
        "i_e": (excited, np.ones_like(own_gain), 1.0),
        "y": (lines.y, own_gain, -1.0),
        "i_c": (i_c, np.ones_like(own_gain), -1.0),
    }
    found = []
    for signal, (columns, gain, sign) in ways.items():
        change = sign * gain[:, :, None] * (columns[:, None, :] - columns[:, :, None])
        cost = np.sum(np.abs(left[:, :, None] + change) ** 2, axis=0)
        rows, order = linear_sum_assignment(cost)
        found.append((signal, order.tolist(), float(np.sqrt(cost[rows, order].sum()) / np.linalg.norm(i_c))))
    return min(found, key=lambda entry: entry[2])


def called_for(loop: NominalLoop, lines: Lines) -> tuple[ComplexArray, ComplexArray]:
    """The excitation that the record calls for, and the recorded one, both weighted, (lines, axes).

    With i_c the controller's equation says it, else y and the nominal closed loop do.
    """
    if lines.i_c is not None:
        excited, fed_back = controller_terms(loop, replace(lines, r=np.zeros_like(lines.r)))
        of_reference = sum(fed_back.values()) - sum(controller_terms(loop, lines)[1].values())
        return lines.i_c + sum(fed_back.values()), excited + of_reference
    closed = loop.closed(lines.frequency_hz)
    weight = np.linalg.norm(closed, axis=(1, 2))[:, None]
    return weight * np.linalg.solve(closed, lines.y[..., None])[..., 0], weight * loop.driven(lines)


def correlation(a: ComplexArray, b: ComplexArray) -> float:
    """Correlation of two sets of spectra of the same shape, in phase, over all lines and axes together."""
    return float(np.real(np.vdot(a, b)) / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-300))


def chance(a: ComplexArray, b: ComplexArray) -> float:
    """Standard deviation of the correlation of two sets of spectra that have nothing to do with each other."""
    overlap = np.sqrt(0.5 * np.sum(np.abs(a) ** 2 * np.abs(b) ** 2))
    return float(overlap / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-300))


def best_order(wanted: ComplexArray, given: ComplexArray) -> list[int]:
    """The order of the columns of `given` that is most like `wanted`."""
    return linear_sum_assignment(-np.real(wanted.conj().T @ given))[1].tolist()


def best_shift(wanted: ComplexArray, given: ComplexArray, lines: Lines) -> tuple[int, float]:
    """By how many samples, round the window, the given excitation is early, and the correlation once it is delayed."""
    cross = np.zeros(lines.window // 2 + 1, dtype=complex)
    cross[lines.index] = np.sum(wanted * given.conj(), axis=1)
    overlap = np.fft.irfft(cross, n=lines.window) * lines.window / 2.0
    shift = int(np.argmax(overlap))
    size = np.linalg.norm(wanted) * np.linalg.norm(given)
    return (shift if shift <= lines.window // 2 else shift - lines.window), float(overlap[shift] / size)


def gain_of(measured: ComplexArray, expected: ComplexArray) -> FloatArray:
    """Rms of the measured columns over that of the expected ones, for each axis that moves."""
    moving = moves(measured)
    return np.linalg.norm(measured[:, moving], axis=0) / np.linalg.norm(expected[:, moving], axis=0)


def moves(columns: ComplexArray) -> NDArray[np.bool_]:
    """Which columns carry more than a few per cent of the strongest."""
    size = np.linalg.norm(columns, axis=0)
    return size > 0.03 * size.max()


def expected_displacement(loop: NominalLoop, lines: Lines) -> ComplexArray:
    """y that the nominal machine makes of i_c, or, where that was not recorded, the nominal closed loop of i_e."""
    if lines.i_c is not None:
        return _times(loop.machine(lines.frequency_hz), lines.i_c)
    return _times(loop.closed(lines.frequency_hz), loop.driven(lines))


def exchanged_axes(loop: NominalLoop, lines: Lines) -> tuple[list[int], float]:
    """The naming of axes, the same in all signals, that the nominal machine fits best; among equals the rig's own.

    Bearings may be exchanged with those of as many axes, and zeta with eta in each.

    Returns
    -------
    order : list of int
        Column to be taken for each axis.
    ratio : float
        What is then missed of y, up to a common factor, over what is missed in the record as it stands.
    """
    f = lines.frequency_hz
    response = loop.closed(f) if lines.i_c is None else loop.machine(f)
    cause = loop.driven(lines) if lines.i_c is None else lines.i_c
    alike = {o: correlation(lines.y[:, o], _times(response, cause[:, o])) for o in _namings(loop.rig)}
    missed = {order: np.sqrt(1.0 - value**2) for order, value in alike.items()}
    best = next(order for order, value in missed.items() if value <= 1.05 * min(missed.values()))
    return list(best), float(missed[best] / missed[tuple(range(loop.axes))])


def _namings(rig: Rig) -> list[tuple[int, ...]]:
    """Orders of the axes that keep those of a bearing together, the rig's first."""
    first = np.cumsum([0, *(len(bearing.axes) for bearing in rig.bearings)])
    groups = [tuple(range(a, b)) for a, b in zip(first[:-1], first[1:], strict=True)]
    found = []
    for bearings in permutations(groups) if len(groups) <= 4 else [groups]:
        if [len(group) for group in bearings] == [len(group) for group in groups]:
            for turns in product((False, True), repeat=len(groups)):
                pairs = zip(bearings, turns, strict=True)
                found.append(tuple(j for group, turned in pairs for j in (group[::-1] if turned else group)))
    return found


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


def _times(response: ComplexArray, signal: ComplexArray) -> ComplexArray:
    return (response @ signal[..., None])[..., 0]
