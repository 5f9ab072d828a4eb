"""Noise where no line is unexcited, by local polynomial regression.

Without periods every line is excited. What of R follows the excitation with a gain that is smooth over frequency, and
what is left of a transient, is then no noise: S is what a local regression on both leaves (Pintelon and Schoukens,
System Identification: A Frequency Domain Approach, 2nd ed., chapter 7).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.noise.envelope import Envelope

__all__ = ["beside_excitation", "likelier_beside_excitation"]

DEGREE = 2
"""Of the polynomials over frequency in the local regression."""
REGRESSED = 6
"""Lines in a local regression, per number that it fits."""
ENOUGH = 3
"""Free lines in a regression, per channel: with fewer S is known too badly for J to be 1 when the model is right."""
TOGETHER = 1024
"""Regressions that are held in memory at a time."""
SMOOTH = 1.0 / 3.0
"""Part of a line's number over which the power of noise is even."""
NARROWEST, WIDEST = 8, 40
"""Lines to each side that the power around a line is taken from, at the least and at the most."""
LEAST_WIDTH = 31
"""Lines in a local regression, if more are not needed."""


def beside_excitation(lines: ComplexArray, excitation: ComplexArray) -> tuple[ComplexArray, FloatArray, float]:
    """S at every line from what a local regression on the excitation and on a transient leaves, shape (lines, p, p).

    With q numbers fitted to m lines, the noise has nu = m - q degrees of freedom. A line is one of those that S was
    estimated from, but for the part q / m of it that was fitted; that part alone needs Hotelling's factor.

    Returns
    -------
    ndarray, shape (lines, p, p)
    ndarray, shape (lines, p)
        Power of the noise of every line and channel by itself.
    float
        See `Spectrum.spread`: what a smooth gain makes of the excitation has no part in S.
    """
    count, p = lines.shape
    fitted = (excitation.shape[1] + 1) * (DEGREE + 1)
    width = min(max(LEAST_WIDTH, REGRESSED * fitted), count - 2)
    free = width - fitted
    if free < ENOUGH * p:
        raise RecordError(
            f"{count} lines are too few to tell the noise of {p} channels from what follows {excitation.shape[1]} "
            "excitations; record for longer, or excite periodically"
        )
    step = max(1, width // 8)
    starts = np.arange(0, count - width + 1, step)
    powers = np.linspace(-1.0, 1.0, width)[:, None] ** np.arange(DEGREE + 1)
    spectrum = np.empty((len(starts), p, p), dtype=complex)
    own_power = np.empty((count, p))
    nearest = np.clip(np.round((np.arange(count) - width / 2) / step), 0, len(starts) - 1).astype(np.intp)
    for first in range(0, len(starts), TOGETHER):
        own_starts = starts[first : first + TOGETHER]
        rows = own_starts[:, None] + np.arange(width)
        inputs = np.concatenate([excitation[rows], np.ones((len(rows), width, 1))], axis=2)
        table = (inputs[..., None] * powers[:, None, :]).reshape(len(rows), width, fitted)
        size = np.linalg.norm(table, axis=1, keepdims=True)
        basis, _ = np.linalg.qr(table / np.where(size > 0.0, size, 1.0))
        own = lines[rows]
        left = own - basis @ (basis.conj().transpose(0, 2, 1) @ own)
        spectrum[first : first + TOGETHER] = np.einsum("slc,sld->scd", left, left.conj()) / free
        here = np.flatnonzero((nearest >= first) & (nearest < first + len(rows)))
        at = nearest[here] - first
        place = np.clip(here - own_starts[at], 0, width - 1)
        own_power[here] = np.abs(left[at, place]) ** 2 * width / free
    factor = (free + fitted * free / (free - p)) / width
    return np.asarray(factor * spectrum[nearest]), own_power, free / (free - p) / factor


def likelier_beside_excitation(
    lines: ComplexArray, excitation: ComplexArray, shapes: Sequence[ComplexArray]
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """S at every line behind the shape, (lines, p, p), under which the lines are likeliest, that shape, and the spread.

    Noise whose power changes within a regression, as near a peak or towards zero frequency, is made even first: each
    shape is also tried with the power of the lines around, or a smooth `Envelope`, taken out of every channel.
    """
    best: tuple[float, ComplexArray, ComplexArray] | None = None
    for back in shapes:
        behind = (back @ lines[..., None])[..., 0]
        spectrum, power, spread = beside_excitation(behind, excitation)
        ways = [(back, spectrum, 0.0)]
        for root, numbers in (_around(power), _envelope(power)):
            flat, *_ = beside_excitation(behind / root, excitation)
            ways.append((back / root[:, :, None], flat, numbers))
        for shape, own, cost in ways:
            likely = _likelihood(own, shape) - cost
            if best is None or likely > best[0]:
                best = (likely, own, shape)
    assert best is not None, "there is a shape"
    return best[1], best[2], np.full(len(lines), spread)


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


def _likelihood(spectrum: ComplexArray, shape: ComplexArray) -> float:
    """Logarithm of the likelihood that a residual has this spectrum behind its shape, but for a constant (Whittle)."""
    return float(np.sum(2.0 * np.linalg.slogdet(shape)[1] - np.linalg.slogdet(spectrum)[1]))
