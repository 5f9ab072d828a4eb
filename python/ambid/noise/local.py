"""Noise where no line is unexcited, by local polynomial regression.

Without periods every line is excited. What of R follows the excitation with a gain that is smooth over frequency, and
what is left of a transient, is then no noise: S is what a local regression on both leaves (Pintelon and Schoukens,
System Identification: A Frequency Domain Approach, 2nd ed., chapter 7).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.noise.envelope import Envelope
from ambid.noise.whitener import SMOOTH

DEGREE = 2
"""Of the polynomials over frequency in the local regression."""
ENOUGH = 3
"""Free lines in a regression, per channel: with fewer S is known too badly for J to be 1 when the model is right."""
MOST_TAKEN = 0.95
"""Part of a line's noise that a regression may take, at the most, for the rest to determine its power."""
FEW = 4000
"""Lines up to which regressions are wide beside the colour of the noise, and are weighted by it."""
NARROWEST, WIDEST = 8, 40
"""Lines to each side that the power around a line is taken from, at the least and at the most."""


class Found(NamedTuple):
    """The noise of a residual."""

    regressions: ComplexArray
    """S of every regression, shape (regressions, p, p)."""
    nearest: NDArray[np.uintp]
    """The regression of every line, shape (lines,)."""
    power: FloatArray
    """Of every line and channel by itself, shape (lines, p)."""
    spread: float
    """See `Spectrum`."""

    @property
    def spectrum(self) -> ComplexArray:
        """S of every line, shape (lines, p, p): large."""
        return self.regressions[self.nearest]

    @property
    def log_determinant(self) -> float:
        """Sum over all lines of the logarithm of the determinant of S."""
        return float(np.sum(np.linalg.slogdet(self.regressions)[1][self.nearest]))


def beside_excitation(
    several: Sequence[ComplexArray], excitation: ComplexArray, roots: Sequence[FloatArray] | None = None
) -> list[Found]:
    """S at every line from what a local regression on the excitation and on a transient leaves, of several residuals.

    With q numbers fitted to m lines, the noise has nu = m - q degrees of freedom. A line is one of those that S was
    estimated from, but for the part q / m of it that was fitted; that part alone needs Hotelling's factor. What a
    smooth gain makes of the excitation has no part in S: along it, the spread is that of independent noise.

    Parameters
    ----------
    several : sequence of ndarray, shape (lines, p)
    excitation : ndarray, shape (lines, axes)
    roots : sequence of ndarray, shape (lines, p), optional
        By which each residual was divided to make its noise even; the regression is weighted alike.

    Returns
    -------
    list of Found
        Of each residual.
    """
    count, p = several[0].shape
    axes, excitation = excitation.shape[1], driving(excitation)
    fitted, width = regression(count, excitation.shape[1])
    free = width - fitted
    if free < ENOUGH * p:
        raise RecordError(
            f"{count} lines are too few to separate the noise of {p} channels from what follows {excitation.shape[1]} "
            "excitations; record for longer, or excite periodically"
        )
    starts = np.append(np.arange(0, count - width, max(1, width // 8)), count - width)  # the last ends with the lines
    middle = starts + 0.5 * (width - 1)
    nearest = np.searchsorted(0.5 * (middle[1:] + middle[:-1]), np.arange(count)).astype(np.uintp)
    factor = (free + fitted * free / (free - p)) / width
    spread = free / (free - p) / factor
    found = []
    for k, lines in enumerate(several):
        weighted = [(p, np.ones(count))] if roots is None else _weighted(roots[k], axes)
        lines = np.ascontiguousarray(lines)
        own, power = _core.local_regressions(
            lines, excitation, weighted, starts.astype(np.uintp), nearest, width, DEGREE, MOST_TAKEN
        )
        found.append(Found(factor / free * own, nearest, power, spread))
    return found


def driving(excitation: ComplexArray | FloatArray) -> Any:
    """The columns that drive anything: a regression on an axis at rest takes lines at random."""
    return np.ascontiguousarray(excitation[:, excitation.any(axis=0)])


def regression(count: int, axes: int) -> tuple[int, int]:
    """Numbers that a local regression fits, and lines that it takes, of so many lines and excited axes."""
    fitted = (axes + 1) * (DEGREE + 1)
    return fitted, min(max(31, 6 * fitted), count - 2)  # lines in a local regression, 6 a number that it fits


def _weighted(root: FloatArray, axes: int) -> list[tuple[int, FloatArray]]:
    """Channels that are weighted alike, by the last one's end: y, then i_c, whose colours differ most."""
    ends = sorted({axes, root.shape[1]} - {0})  # y alone may be recorded, or nothing drive
    level = np.log(root)
    return [(end, np.exp(-level[:, first:end].mean(axis=1))) for first, end in zip([0, *ends], ends, strict=False)]


def likelier_beside_excitation(
    lines: ComplexArray, excitation: ComplexArray, shapes: Sequence[ComplexArray]
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """S at every line behind the shape, (lines, p, p), under which the lines are likeliest, that shape, and the spread.

    Noise whose power changes within a regression, as near a peak or towards zero frequency, is made even first: each
    shape is also tried with the power of the lines around, or a smooth `Envelope`, taken out of every channel. On few
    lines that power is found anew from regressions that are weighted by it: else noise that is loud on a few lines is
    explained away there, and seen on all others.
    """
    behind = [_core.through(back, lines) for back in shapes]
    plain = beside_excitation(behind, excitation)
    tries = [(k, smooth) for k in range(len(shapes)) for smooth in (_around, _envelope)]
    powers = [plain[k].power for k, _ in tries]
    rounds = 2 if len(lines) <= FEW else 1
    for left in reversed(range(rounds)):
        even = [smooth(power) for (_, smooth), power in zip(tries, powers, strict=True)]
        roots = [root for root, _ in even]
        residuals = [behind[k] / root for (k, _), root in zip(tries, roots, strict=True)]
        flat = beside_excitation(residuals, excitation, roots if rounds > 1 else None)
        if left:
            powers = [own.power * root**2 for own, root in zip(flat, roots, strict=True)]
    gains = [float(np.sum(np.linalg.slogdet(back)[1])) for back in shapes]
    # logarithms of the likelihood that a residual has its spectrum behind its shape, but for a constant (Whittle)
    likelihoods = [2.0 * gain - own.log_determinant for gain, own in zip(gains, plain, strict=True)]
    for (k, _), (root, numbers), own in zip(tries, even, flat, strict=True):
        likelihoods.append(2.0 * (gains[k] - float(np.sum(np.log(root)))) - own.log_determinant - numbers)
    best = int(np.argmax(likelihoods))
    if best < len(shapes):
        own, shape = plain[best], shapes[best]
    else:
        (k, _), root, own = tries[best - len(shapes)], roots[best - len(shapes)], flat[best - len(shapes)]
        shape = shapes[k] / root[:, :, None]
    return own.spectrum, shape, np.full(len(lines), own.spread)


def _envelope(power: FloatArray) -> tuple[FloatArray, float]:
    """Root of the envelope of the power at every line, shape (lines, p), and how many numbers that is."""
    angle = np.pi * np.arange(1, len(power) + 1) / (len(power) + 1)
    envelope = Envelope(power, angle)
    return envelope.root(angle), float(np.sum(envelope.orders))


def _around(power: FloatArray) -> tuple[FloatArray, float]:
    """Root of the power around every line, shape (lines, p), and how many numbers that is."""
    count, p = power.shape
    place = np.arange(count)
    reach = np.clip((SMOOTH * place).astype(np.intp), NARROWEST, WIDEST)
    low, high = np.maximum(place - reach, 0), np.minimum(place + reach + 1, count)
    below = np.concatenate([np.zeros((1, p)), np.cumsum(power, axis=0)])
    level = (below[high] - below[low]) / (high - low)[:, None]
    return np.sqrt(np.maximum(level, 1e-300)), float(p * np.sum(1.0 / (high - low)))
