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

from ambid.arrays import ComplexArray
from ambid.model import Model
from ambid.noise import Noise
from ambid.noise.tones import without_tones

__all__ = ["Change", "largest_change"]

FASTEST = 24
"""Cycles per record up to which changes are looked for."""
OUTSTANDING = 21.0
"""Projected power that noise reaches in one of two hundred records: two degrees of freedom, two hundred patterns."""


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


def largest_change(model: Model, noise: Noise) -> Change | None:
    """The change of a parameter of the base model that stands out most, if one does."""
    bases = [(k, name) for k, name in enumerate(model.names) if name.startswith(("K_i", "K_s"))]
    best: Change | None = None
    for record, whitener, tones in zip(noise.records, noise.whiteners, noise.tones, strict=True):
        window, p = whitener.window, len(record.channels)
        if not window.is_periodic:
            continue  # every line is excited
        y, slopes = model.sensitivity(record, [k for k, _ in bases])
        acting = [j for j in range(len(bases)) if slopes[..., j].any()]  # not those of other bias currents
        slopes = slopes[..., acting]
        residual = without_tones(record.outputs - y[:, :p], tones, window, record.sample_rate)
        count = len(window.excited)
        whitening = whitener.whitening[:count]
        patterns = whitening @ window.some_lines(slopes[:, :p], whitener.more[:0])
        energy = np.sum(np.abs(patterns) ** 2, axis=(0, 1))
        lines = window.lines(residual)
        per_line = record.sample_rate / window.samples
        shifts = [d for d in range(1, FASTEST + 1) if d % window.periods]
        amplitudes = np.array([_projected(lines, whitening, patterns, window.excited, d) for d in shifts]) / energy
        powers = 2.0 * energy * np.abs(amplitudes) ** 2
        # a pole that is narrower than a shift spreads its noise over all of them
        powers /= np.maximum(np.median(powers, axis=0) / (2.0 * np.log(2.0)), 1.0)
        k, j = np.unravel_index(np.argmax(powers), powers.shape)
        if powers[k, j] > OUTSTANDING and (best is None or powers[k, j] > best.power):
            index, name = bases[acting[j]]
            relative = 2.0 * float(np.abs(amplitudes[k, j])) / abs(model.theta[index])
            d = shifts[k]
            best = Change(record.name, name, d * per_line, d, relative, float(powers[k, j]))
    return best


def _projected(
    lines: ComplexArray, whitening: ComplexArray, patterns: ComplexArray, excited: NDArray[np.intp], d: int
) -> ComplexArray:
    """What stands d lines beside the excited ones, on both sides, in the directions of the patterns."""
    sides = []
    for shift in (d, -d):
        at = excited + shift
        inside = (at > 0) & (at < len(lines))
        moved = np.where(inside[:, None], lines[np.clip(at, 0, len(lines) - 1)], 0.0)
        sides.append(np.einsum("kcj,kc->j", patterns.conj(), (whitening @ moved[..., None])[..., 0]))
    return np.asarray(0.5 * (sides[0] + sides[1].conj()), dtype=np.complex128)
