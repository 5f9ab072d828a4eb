"""Lines of a frequency response that say nothing, taken out with a finding that says which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ComplexArray, FloatArray
from ambid.findings import Finding, Kind

__all__ = ["Lines", "informative"]

ZERO_FREQUENCY = Kind(
    "zero_frequency_not_used", "note", "the line at 0 Hz is not used: a mean is no response to the excitation"
)
ZERO_VALUES = Kind(
    "zero_values_not_used",
    "note",
    "values of exactly zero, not used: {count} ({pairs}[ and {more} more pairs], at {frequencies_hz:g} Hz)",
)
COHERENCE_MISSING = Kind(
    "coherence_missing",
    "note",
    "values whose coherence is zero or missing, not used: {count} ({pairs}[ and {more} more pairs], at "
    "{frequencies_hz:g} Hz)",
)
MOST_LISTED = 3
"""Pairs, and frequencies of each, that a finding names one by one."""


@dataclass(frozen=True)
class Lines:
    """Frequencies [Hz], shape (F,), and tables of shape (F, outputs, inputs), of the covariance (F, pairs, pairs)."""

    frequency_hz: FloatArray
    response: ComplexArray
    std: FloatArray
    coherence: FloatArray
    covariance: ComplexArray | None = None


def informative(lines: Lines, pairs: Sequence[str]) -> tuple[Lines, list[Finding]]:
    """Lines without the one at 0 Hz, with NaN for single values that are zero or have no coherence; and findings.

    A pair that is zero everywhere, or has no coherence anywhere, stays as it is.
    """
    findings = []
    at_zero = lines.frequency_hz == 0.0
    if at_zero.any():
        findings.append(ZERO_FREQUENCY(frequencies_hz=[0.0]))
        kept = ~at_zero
        covariance = None if lines.covariance is None else lines.covariance[kept]
        lines = Lines(
            lines.frequency_hz[kept], lines.response[kept], lines.std[kept], lines.coherence[kept], covariance
        )
    response = lines.response.copy()
    zero = (response == 0.0) & (np.nan_to_num(response) != 0.0).any(axis=0)
    counts = np.isnan(lines.std).all(axis=0) & (lines.coherence > 0.0).any(axis=0) & (lines.covariance is None)
    silent = (np.isnan(lines.coherence) | (lines.coherence == 0.0)) & counts
    silent &= np.isfinite(response) & ~zero
    for kind, wrong in ((ZERO_VALUES, zero), (COHERENCE_MISSING, silent)):
        if wrong.any():
            findings.append(_finding(kind, wrong, lines.frequency_hz, pairs))
            response[wrong] = np.nan
    return replace(lines, response=response), findings


def _finding(kind: Kind, wrong: NDArray[np.bool_], frequency_hz: FloatArray, pairs: Sequence[str]) -> Finding:
    flat = wrong.reshape(len(wrong), -1)
    columns = np.flatnonzero(flat.any(axis=0)).tolist()
    at = [frequency_hz[flat[:, k]].tolist()[:MOST_LISTED] for k in columns[:MOST_LISTED]]
    more = len(columns) - MOST_LISTED if len(columns) > MOST_LISTED else None
    return kind(count=int(flat.sum()), pairs=[pairs[k] for k in columns[:MOST_LISTED]], frequencies_hz=at, more=more)
