"""What transients can look like on lines: orthonormal bases, and what is free from them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft
from scipy.linalg import eigh

from ambid.arrays import ComplexArray, FloatArray
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.wave import NEAR
from ambid.noise.window import DampedWindow, Window

OWN = 1e-10
"""Part of the largest eigenvalue of the transient's Gram matrix below which a direction of it says nothing."""


def orthonormal(basis: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns, without directions that are nearly those of others."""
    size = np.linalg.norm(basis, axis=0)
    if not size.any():
        return np.zeros((len(basis), 0))
    scaled = basis[:, size > 0.0] / size[size > 0.0]
    values, vectors = eigh(scaled.T @ scaled)
    kept = values > OWN * values.max(initial=0.0)
    return np.asarray(scaled @ (vectors[:, kept] / np.sqrt(values[kept])))


def freed(signal: FloatArray, basis: FloatArray) -> FloatArray:
    """What an orthonormal basis cannot take over."""
    return np.asarray(signal - basis @ (basis.T @ signal))


WIDTHS = 4.0
"""Half-widths of a pole about its frequency that its lines are taken from: there nine tenths of its power stand."""


def lines_beside_poles(here: Model, window: Window, sample_rate: float, but: Sequence[Tone]) -> NDArray[np.intp]:
    """Unexcited lines that show a transient whose poles are narrower than the gap between two excited lines, in order.

    What such a transient does in time it does on a few lines about the frequency of its pole. The excited ones beside
    them hold little of it, and would take its size from their noise. None of a record without periods, all of whose
    lines are judged.

    Parameters
    ----------
    here : Model
    window : Window
    sample_rate : float
        [Hz].
    but : sequence of Tone
        Lines next to them show nothing else.
    """
    if not window.is_periodic or isinstance(window, DampedWindow):
        return np.zeros(0, dtype=np.intp)
    line = 2.0 * np.pi * sample_rate / window.samples  # [rad/s]
    places = [2.0 * np.pi * tone.frequency_hz / line for tone in but]
    found: set[int] = set()
    for pole in here.loop.core.poles(here.theta):
        half = WIDTHS * abs(pole.real) / line
        if abs(pole.real) < window.periods * line:
            # half of the lines about a pole; what is wider than they reach is determined by the excited ones
            reach = int(np.ceil(np.clip(half, 1.0, 12.0)))
            centre = int(round(abs(pole.imag) / line))
            found.update(range(centre - reach, centre + reach + 1))
    inside = (l for l in found if 0 < l < window.samples // 2 and l % window.periods)
    return np.array(sorted(l for l in inside if all(abs(l - place) > NEAR for place in places)), dtype=np.intp)


def some_lines(window: Window, signal: FloatArray, index: NDArray[np.intp]) -> ComplexArray:
    """Lines of a signal that starts with the record, shape (lines, columns); one by one, for the memory."""
    columns = [rfft(column)[index] for column in window.cut(signal).T]
    return np.ascontiguousarray(np.array(columns, dtype=complex).T / np.sqrt(window.samples))
