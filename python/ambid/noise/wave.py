"""What a wave of one frequency is on the lines of a record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ambid.arrays import ComplexArray, FloatArray
from ambid.noise.window import Window

__all__ = ["refined_frequency", "wave_between"]

NEAR = 15
"""Lines to each side of a wave that tell its amplitude and its frequency."""


def refined_frequency(quiet: ComplexArray, window: Window, place: float) -> float:
    """Place between lines whose wave explains most of all channels, within a line to each side.

    Parameters
    ----------
    quiet : ndarray, shape (M N / 2 + 1, p)
        As they were recorded.
    window : Window
        That they are of.
    place : float
        In lines.
    """
    near = _unexcited_near(window, place)
    lines = quiet[near]
    scaled = lines / np.sqrt(np.median(np.abs(lines) ** 2, axis=0) + 1e-300)

    def left(at: float) -> float:
        table, rows = _table_near(window, at, near), _rows(scaled)
        rest = rows - table @ np.linalg.lstsq(table, rows, rcond=None)[0]
        return float(np.sum(rest**2))

    found = minimize_scalar(left, bounds=(place - 1.0, place + 1.0), method="bounded", options={"xatol": 1e-7})
    return float(found.x)


def wave_between(quiet: ComplexArray, window: Window, cycles: float, index: NDArray[np.intp]) -> ComplexArray:
    """The wave of so many cycles per sample, by the unexcited lines nearest to it, on some lines, shape (index, p)."""
    place = cycles * window.samples
    near = _unexcited_near(window, place)
    amplitudes = np.linalg.lstsq(_table_near(window, place, near), _rows(quiet[near]), rcond=None)[0]
    both = _table(window, place, index) @ amplitudes[:2]
    return np.asarray(both[: len(index)] + 1j * both[len(index) :])


def _unexcited_near(window: Window, place: float) -> NDArray[np.intp]:
    near = np.arange(max(1, round(place) - NEAR), min((window.samples - 1) // 2, round(place) + NEAR) + 1)
    return near[near % window.periods != 0]


def _table_near(window: Window, place: float, near: NDArray[np.intp]) -> FloatArray:
    """The same, and what transients leave beside them: a complex number and its slope."""
    smooth = np.stack([np.ones(len(near)), (near - place) / NEAR], axis=1)
    nothing = np.zeros_like(smooth)
    return np.hstack([_table(window, place, near), np.vstack([smooth, nothing]), np.vstack([nothing, smooth])])


def _table(window: Window, place: float, index: NDArray[np.intp]) -> FloatArray:
    """Cosine and sine of unit amplitude on lines; real, then imaginary parts."""
    n = window.samples
    up, down = _kernel(place - index, n), _kernel(-place - index, n)
    waves = np.stack([up + down, 1j * (up - down)], axis=1)
    return np.asarray(np.concatenate([waves.real, waves.imag]))


def _kernel(off: NDArray[Any], n: int) -> ComplexArray:
    """Dirichlet's: the mean of exp(2 pi i off k / n) over k = 0 .. n - 1, in units of the lines."""
    shape = np.sinc(off) / np.sinc(off / n) * np.exp(1j * np.pi * off * (1.0 - 1.0 / n))
    return np.asarray(0.5 * np.sqrt(n) * shape)


def _rows(lines: ComplexArray) -> FloatArray:
    return np.concatenate([lines.real, lines.imag])
