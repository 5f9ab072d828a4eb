"""Excitations that are within limits, one period each, and how long each must be played for equal accuracy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ambid.arrays import ByValue, FloatArray
from ambid.designs.intervals import FEWEST, Prospect, prospect
from ambid.designs.peaks import MOST_OF_POWER, Limits, forecast
from ambid.designs.powers import PoweredLines, best_powers, criterion
from ambid.excitation import MULTISINE, PRBS, multisine, prbs
from ambid.model import Model
from ambid.noise.foreseen import Instruments

SIGNALS = (PRBS, MULTISINE)


@dataclass(frozen=True, eq=False)
class Task:
    """What an excitation is for.

    Attributes
    ----------
    model : Model
        Linear.
    free : list of int
        Parameters that count.
    scale : ndarray, shape (free,)
        What they are relative to.
    wanted : ndarray, shape (free, free), or None
        C of the A-criterion tr(C cov), cov relative; None for the volume of the confidence region.
    instruments : Instruments
    limits : Limits
    period : int
        Samples of a period, or about so many.
    spread : float
        Part of a multisine's power that all lines share evenly, so that what the model lacks shows on each.
    """

    model: Model
    free: list[int]
    scale: FloatArray
    wanted: FloatArray | None
    instruments: Instruments
    limits: Limits
    period: int
    spread: float

    def criterion_of(self, expected: Prospect) -> float:
        """What is to be small, of what a record would show."""
        names, own = self.model.names, [expected.model.names[i] for i in expected.model.free]
        at = [own.index(names[k]) for k in self.free]
        relative = expected.covariance[np.ix_(at, at)] / np.outer(self.scale, self.scale)
        return criterion(np.asarray(np.linalg.inv(relative)), self.wanted)


@dataclass(frozen=True, eq=False)
class Option(ByValue):
    """One period of an excitation whose largest peak just reaches its limit.

    Attributes
    ----------
    signal : str
    settings : dict
        What it was made with.
    wave : ndarray, shape (period, axes)
    cost : float
        The criterion times the seconds of the record: of two, so many times longer must one be played.
    """

    signal: str
    settings: dict[str, float]
    wave: FloatArray
    cost: float

    @classmethod
    def of(cls, task: Task, signal: str, settings: dict[str, float], wave: FloatArray) -> Option:
        """Scale a wave to its limit, and see what it determines."""
        wave = wave / _load(task, wave)
        accuracy = prospect(task.model, np.tile(wave, (FEWEST, 1)), period=len(wave), instruments=task.instruments)
        cost = task.criterion_of(accuracy) * accuracy.seconds
        return cls(signal, settings | {"peak": float(np.abs(wave).max())}, wave, cost)


def compared(task: Task, signal: str | None) -> tuple[list[Option], float]:
    """All options of a signal, or of both, the best first; and the efficiency that `multisines` proves, else NaN."""
    options, efficiency = multisines(task) if signal != PRBS else ([], np.nan)
    if signal != MULTISINE:
        options += list(sequences(task))
    return sorted(options, key=lambda own: own.cost), efficiency


def sequences(task: Task) -> Iterator[Option]:
    """Pseudo-random binary sequences of about the period, each with another hold."""
    for hold in (1, 2, 4, 8, 16):
        order = min(range(5, 18), key=lambda n: abs(np.log((2**n - 1) * hold / task.period)))
        wave = prbs(order, amplitude=1.0, hold=hold, axes=len(task.model.rig.axes))
        yield Option.of(task, PRBS, {"order": order, "hold": hold}, wave)


def multisines(task: Task) -> tuple[list[Option], float]:
    """Multisines between one of flat load and one of the best powers, and the proven efficiency of the best powers.

    Those of few lines have the best powers, and the higher peaks: they show which is best within limits of peaks.
    """
    lines = PoweredLines.of(task.model, task.period, task.instruments, task.limits, task.free, task.scale)
    best = best_powers(lines, task.wanted)
    flat = best.on_the_way[0]
    found = []
    for powers in (*best.on_the_way, best.powers):
        mixed = (1.0 - task.spread) * powers + task.spread * flat
        mixed[mixed < 1e-6 * mixed.max()] = 0.0
        wave = min((_wave(task, lines, mixed, signal) for signal in lines.answers), key=lambda own: _load(task, own))
        found.append(Option.of(task, MULTISINE, {"period": task.period, "lines": _strong(mixed)}, wave))
    return found, best.efficiency


def _load(task: Task, wave: FloatArray) -> float:
    """Largest peak over its limit."""
    return forecast(task.model, np.tile(wave, (2, 1)), period=len(wave), limits=task.limits).load


def _strong(powers: FloatArray) -> int:
    """Lines that hold most of the power."""
    return int(np.searchsorted(np.cumsum(np.sort(powers)[::-1]), MOST_OF_POWER * powers.sum())) + 1


def _wave(task: Task, lines: PoweredLines, powers: FloatArray, signal: str) -> FloatArray:
    """One period of i_e with these powers, whose phases give a signal of each axis low peaks."""
    axes = len(task.model.rig.axes)
    spectrum = np.zeros((task.period // 2 + 1, axes), dtype=complex)
    for axis in range(axes):
        own = np.arange(axis, len(powers), axes)
        own = own[powers[own] > 0.0]
        if own.size:
            at, answer = lines.lines[own], lines.answers[signal][own]
            heard = np.maximum(powers[own] * np.abs(answer) ** 2, np.finfo(float).tiny)
            low = multisine(task.period, rms=1.0, lines=at.tolist(), powers=heard, phases="clipped")[:, 0]
            turned = np.angle(np.fft.rfft(low)[at]) - np.angle(answer)
            spectrum[at, axis] = np.sqrt(2.0 * powers[own]) * task.period / 2.0 * np.exp(1j * turned)
    return np.asarray(np.fft.irfft(spectrum, n=task.period, axis=0))
