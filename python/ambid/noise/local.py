"""Noise where no line is unexcited, by local polynomial regression.

Without periods every line is excited. What of R follows the excitation with a gain that is smooth over frequency, and
what is left of a transient, is then no noise: S is what a local regression on both leaves (Pintelon and Schoukens,
System Identification: A Frequency Domain Approach, 2nd ed., chapter 7).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.arrays import ComplexArray
from ambid.errors import RecordError

__all__ = ["beside_excitation", "likelier_beside_excitation"]

DEGREE = 2
"""Of the polynomials over frequency in the local regression."""
REGRESSED = 6
"""Lines in a local regression, per number that it fits."""
TOGETHER = 1024
"""Regressions that are held in memory at a time."""
LEAST_WIDTH = 31
"""Lines in a local regression, if more are not needed."""


def beside_excitation(lines: ComplexArray, excitation: ComplexArray) -> ComplexArray:
    """S at every line from what a local regression on the excitation and on a transient leaves, shape (lines, p, p).

    With q numbers fitted to m lines, the noise has nu = m - q degrees of freedom. A line is one of those that S was
    estimated from, but for the part q / m of it that was fitted; that part alone needs Hotelling's factor.
    """
    count, p = lines.shape
    fitted = (excitation.shape[1] + 1) * (DEGREE + 1)
    width = min(max(LEAST_WIDTH, REGRESSED * fitted), count - 2)
    free = width - fitted
    if free <= p:
        raise RecordError(
            f"{count} lines are too few to tell the noise of {p} channels from what follows {excitation.shape[1]} "
            "excitations; record for longer, or excite periodically"
        )
    step = max(1, width // 8)
    starts = np.arange(1, count - width, step)
    powers = np.linspace(-1.0, 1.0, width)[:, None] ** np.arange(DEGREE + 1)
    spectrum = np.empty((len(starts), p, p), dtype=complex)
    for first in range(0, len(starts), TOGETHER):
        rows = starts[first : first + TOGETHER, None] + np.arange(width)
        inputs = np.concatenate([excitation[rows], np.ones((len(rows), width, 1))], axis=2)
        table = (inputs[..., None] * powers[:, None, :]).reshape(len(rows), width, fitted)
        size = np.linalg.norm(table, axis=1, keepdims=True)
        basis, _ = np.linalg.qr(table / np.where(size > 0.0, size, 1.0))
        own = lines[rows]
        left = own - basis @ (basis.conj().transpose(0, 2, 1) @ own)
        spectrum[first : first + TOGETHER] = np.einsum("slc,sld->scd", left, left.conj()) / free
    spectrum *= (free + fitted * free / (free - p)) / width
    nearest = np.clip(np.round((np.arange(count) - width / 2 - 1) / step), 0, len(starts) - 1).astype(np.intp)
    return np.asarray(spectrum[nearest])


def likelier_beside_excitation(
    lines: ComplexArray, excitation: ComplexArray, shapes: Sequence[ComplexArray]
) -> tuple[ComplexArray, ComplexArray]:
    """S at every line behind the shape, (lines, p, p), under which the lines are likeliest, and that shape."""
    tried = [(beside_excitation((back @ lines[..., None])[..., 0], excitation), back) for back in shapes]
    return max(tried, key=lambda one: _likelihood(*one))


def _likelihood(spectrum: ComplexArray, shape: ComplexArray) -> float:
    """Logarithm of the likelihood that a residual has this spectrum behind its shape, but for a constant (Whittle)."""
    return float(np.sum(2.0 * np.linalg.slogdet(shape)[1] - np.linalg.slogdet(spectrum)[1]))
