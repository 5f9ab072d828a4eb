"""Do parameters change during a record? What does not repeat, held against the patterns of the parameters.

If K_i of an axis changes as m(t), the response changes by about m(t) psi(t), psi being its derivative by K_i. On the
excited lines l = M k of the spectrum stands psi; what m(t) holds at d cycles per record moves it to the lines M k + d.
The residual there, whitened, is projected on psi; noise alone leaves a chi-squared of two degrees. A ramp stands
mostly at one cycle per record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ambid.arrays import ComplexArray, FloatArray
from ambid.diagnosis.chance import independent_tests
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.lines import RecordLines, as_lines
from ambid.noise.tones import Between

__all__ = ["Change", "largest_change"]

FASTEST = 24
"""Cycles per record up to which changes are looked for."""
RARE = 1e-4
"""Chance that noise alone is taken for a change of some parameter."""


@dataclass(frozen=True)
class Change:
    """A parameter that changes while the record is taken.

    Attributes
    ----------
    record, parameter : str
        The parameter whose pattern the change fits best.
    frequency_hz : float
        Of the change.
    cycles : int
        In the part of the record that counts; one stands for a drift.
    relative : float
        Amplitude of the change over the parameter's value.
    power : float
        In units of noise, 2 where nothing changes.
    """

    record: str
    parameter: str
    frequency_hz: float
    cycles: int
    relative: float
    power: float


def largest_change(comparison: Comparison) -> Change | None:
    """The change of a parameter of the base model that stands out most, if one does.

    The noise is that of the residual of the comparison's own model.
    """
    model = comparison.model
    bases = [(k, name) for k, name in enumerate(model.names) if name.startswith(("K_i", "K_s"))]
    found: list[Change] = []
    tried = 0.0
    for part in comparison.noise.in_time:
        record, window = part.record, part.window.settled
        # nearer to its own excited line than to the next: a shift further on is one of the next back
        shifts = np.arange(1, min(FASTEST, (window.periods - 1) // 2) + 1)
        if not len(shifts):
            continue  # every line is excited, or the two sides of one are those of the next
        patterns = _patterns(part, model, [k for k, _ in bases])
        acting = np.flatnonzero(np.abs(patterns).max(axis=(0, 1)) > 0.0)  # not those of other bias currents
        patterns = patterns[..., acting]
        amplitudes, powers = _sideband_powers(part, patterns, shifts)
        stacked = patterns.reshape(-1, len(acting))
        unit = stacked / np.linalg.norm(stacked, axis=0)
        tried += len(shifts) * independent_tests(unit.conj().T @ unit, len(acting))
        k, j = np.unravel_index(np.argmax(powers), powers.shape)
        index, name = bases[acting[j]]
        relative = 2.0 * float(np.abs(amplitudes[k, j])) / abs(model.theta[index])
        d, per_line = int(shifts[k]), record.sample_rate / window.samples
        found.append(Change(record.name, name, d * per_line, d, relative, float(powers[k, j])))
    best = max(found, key=lambda change: change.power, default=None)
    return best if best is not None and best.power > chdtri(2, RARE / tried) else None


def _patterns(part: RecordLines, model: Model, free: list[int]) -> ComplexArray:
    """Whitened derivatives on the excited lines, shape (lines, p, free)."""
    count, p = len(part.window.excited), len(part.record.channels)
    slopes = part.slopes(model.at(part.record), free)
    return as_lines(slopes, p)[:count]


def _sideband_powers(
    part: RecordLines, patterns: ComplexArray, shifts: NDArray[np.intp]
) -> tuple[ComplexArray, FloatArray]:
    """Amplitude of each pattern at each shift, and its power in units of noise, both of shape (shifts, patterns)."""
    window = part.window.settled
    between = Between.of(part, window.between(window.periods), part.tones)
    count = len(window.excited)
    # the lines have been taken back through the loop, each at its own frequency; what is left of S is smooth
    inner = part.spectrum.inner[:count]
    sides = np.array([d * side for d in shifts for side in (1, -1)])
    at = window.excited[:, None] + sides
    inside = (at > 0) & (at < len(between.lines))
    moved = np.where(inside[..., None], between.lines[np.clip(at, 0, len(between.lines) - 1)], 0.0)
    white = np.einsum("kcd,ksd->ksc", inner, moved)
    # noise with peaks that the spectrum does not follow is louder at some lines, whatever the shift
    power = np.mean(np.abs(white) ** 2, axis=2) / 2.0
    others = np.abs(sides)[:, None] != np.abs(sides)
    louder = np.maximum(1.0, power @ others / np.maximum(inside @ others, 1))
    white /= np.sqrt(louder)[..., None]
    energy = np.sum(np.abs(patterns) ** 2, axis=(0, 1))
    found = np.einsum("kcj,ksc->sj", patterns.conj(), white) / energy
    amplitudes = 0.5 * (found[0::2] + found[1::2].conj())
    return amplitudes, 2.0 * energy * np.abs(amplitudes) ** 2
