"""Unexcited lines that tell a transient where its poles are narrower than the gap between two excited lines.

What such a transient does in time it does on a few lines about the frequency of its pole. The excited ones beside them
hold little of it, and would tell its size by their noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.damped import DampedWindow
from ambid.noise.wave import NEAR
from ambid.noise.window import Window

__all__ = ["lines_beside_poles", "some_lines"]

WIDTHS = 4.0
"""Half-widths of a pole about its frequency that its lines are taken from: there nine tenths of its power stand."""
MOST_BESIDE = 24
"""Lines about a pole; what is wider than they reach is told by the excited ones."""


def lines_beside_poles(here: Model, window: Window, sample_rate: float, but: Sequence[Tone]) -> NDArray[np.intp]:
    """Indices of these lines, in order; none of a record without periods, all of whose lines are judged.

    Parameters
    ----------
    here : Model
    window : Window
    sample_rate : float
        [Hz].
    but : sequence of Tone
        Lines next to them tell nothing else.
    """
    if not window.is_periodic or isinstance(window, DampedWindow):
        return np.zeros(0, dtype=np.intp)
    line = 2.0 * np.pi * sample_rate / window.samples  # [rad/s]
    places = [2.0 * np.pi * tone.frequency_hz / line for tone in but]
    found: set[int] = set()
    for pole in here.loop.core.poles(here.theta):
        half = WIDTHS * abs(pole.real) / line
        if abs(pole.real) < window.periods * line:
            reach = int(np.ceil(np.clip(half, 1.0, MOST_BESIDE / 2)))
            centre = int(round(abs(pole.imag) / line))
            found.update(range(centre - reach, centre + reach + 1))
    inside = (l for l in found if 0 < l < window.samples // 2 and l % window.periods)
    return np.array(sorted(l for l in inside if all(abs(l - place) > NEAR for place in places)), dtype=np.intp)


def some_lines(window: Window, signal: FloatArray, index: NDArray[np.intp]) -> ComplexArray:
    """Lines of a signal that starts with the record, shape (lines, columns); one by one, for the memory."""
    columns = [rfft(column)[index] for column in window.cut(signal).T]
    return np.ascontiguousarray(np.array(columns, dtype=complex).T / np.sqrt(window.samples))
