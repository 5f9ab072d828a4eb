"""What waves of single frequencies are on the lines of a record."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ambid.arrays import ComplexArray, FloatArray, stacked
from ambid.noise.window import Window

OUTSTANDING = 70.0
"""Power of a tone over that around it; noise alone reaches 40 in a few of a hundred records of 60 000 lines."""
NEAR = 15
"""Lines to each side of a wave that determine its amplitude and its frequency."""


def refined_places(quiet: ComplexArray, window: Window, places: Sequence[float]) -> list[float]:
    """Places between lines whose waves explain most of all channels, each within a line of where it was.

    Parameters
    ----------
    quiet : ndarray, shape (M N / 2 + 1, p)
        As they were recorded.
    window : Window
        That they are of.
    places : sequence of float
        In lines; the last one to a line, the others refined before.
    """
    found = list(places)
    for _ in range(2 if len(found) > 1 else 1):  # so often is every frequency refined beside those of the others
        for k in reversed(range(len(found))):
            others = [other for other in found if other != found[k] and abs(other - found[k]) < 2 * NEAR]
            found[k] = _refined(quiet, window, found[k], others)
    return found


def _refined(quiet: ComplexArray, window: Window, place: float, others: list[float]) -> float:
    near = _near(window, [place, *others])
    rows = stacked(quiet[near])
    rows = rows[:, rows.any(axis=0)]

    def left(at: float) -> float:  # the likelihood of channels whose noise is not known
        table = _table_near(window, [at, *others], near)
        rest = rows - table @ np.linalg.lstsq(table, rows, rcond=None)[0]
        return float(np.sum(np.log(np.sum(rest**2, axis=0))))

    found = minimize_scalar(left, bounds=(place - 1.0, place + 1.0), method="bounded", options={"xatol": 1e-7})
    return float(found.x)


def waves_between(
    quiet: ComplexArray, window: Window, places: Sequence[float], index: NDArray[np.intp]
) -> ComplexArray:
    """The waves at these places, by the unexcited lines nearest to them, on other lines, shape (index, p)."""
    if not len(places):
        return np.zeros((len(index), quiet.shape[1]), dtype=complex)
    near = _near(window, places)
    amplitudes = np.linalg.lstsq(_table_near(window, places, near), stacked(quiet[near]), rcond=None)[0]
    both = _table(window, places, index) @ amplitudes[: 2 * len(places)]
    return np.asarray(both[: len(index)] + 1j * both[len(index) :])


def _near(window: Window, places: Sequence[float]) -> NDArray[np.intp]:
    """The unexcited lines near any of the places; without periods all that are near."""
    around = np.unique(np.add.outer(np.round(places).astype(np.intp), np.arange(-NEAR, NEAR + 1)))
    is_unexcited = (around % window.periods != 0) | (not window.is_periodic)
    return around[(around > 0) & (around <= (window.samples - 1) // 2) & is_unexcited]


def _table_near(window: Window, places: Sequence[float], near: NDArray[np.intp]) -> FloatArray:
    """The waves, and what transients leave beside each of them: a complex number and its slope."""
    parts = [_table(window, places, near)]
    for place in places:
        own = np.abs(near - round(place)) <= NEAR
        smooth = np.stack([own, own * (near - place) / NEAR], axis=1)
        nothing = np.zeros_like(smooth)
        parts += [np.vstack([smooth, nothing]), np.vstack([nothing, smooth])]
    return np.hstack(parts)


def _table(window: Window, places: Sequence[float], index: NDArray[np.intp]) -> FloatArray:
    """Cosine and sine of unit amplitude of each place on lines; real, then imaginary parts."""
    n, columns = window.samples, []
    for place in places:
        up, down = _kernel(place - index, n), _kernel(-place - index, n)
        columns += [up + down, 1j * (up - down)]
    waves = np.stack(columns, axis=1)
    return stacked(waves)


def _kernel(off: NDArray[Any], n: int) -> ComplexArray:
    """Dirichlet's: the mean of exp(2 pi i off k / n) over k = 0 .. n - 1, in units of the lines."""
    shape = np.sinc(off) / np.sinc(off / n) * np.exp(1j * np.pi * off * (1.0 - 1.0 / n))
    return np.asarray(0.5 * np.sqrt(n) * shape)
