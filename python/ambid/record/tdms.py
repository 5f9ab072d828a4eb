"""What TDMS files state of the instants of their channels."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from ambid.record.timing import Timing

__all__ = ["timing_of"]

FRACTIONS = 1 << 64
"""Parts of a second that a time stamp counts."""


def timing_of(properties: Mapping[str, Mapping[str, Any]]) -> dict[str, Timing]:
    """Timing of the channels of a file, by name, with the earliest start as the origin.

    Parameters
    ----------
    properties : mapping of str to mapping
        Of each channel; ``wf_increment`` [s], ``wf_start_time`` as it is stored, and ``wf_start_offset`` [s] from there
        to the first sample (NI, "TDMS File Format Internal Structure"; NI, waveform properties).
    """
    stamps = {name: _stamp(own) for name, own in properties.items()}
    if not any(stamps.values()) and any("wf_start_offset" in own for own in properties.values()):
        stamps = dict.fromkeys(properties, Fraction(0))  # offsets from an instant that all share
    starts = {
        name: None if (stamp := stamps[name]) is None else stamp + Fraction(_number(own.get("wf_start_offset")) or 0.0)
        for name, own in properties.items()
    }
    origin = min((start for start in starts.values() if start is not None), default=Fraction(0))
    return {
        name: Timing(_increment(own), None if (start := starts[name]) is None else float(start - origin))
        for name, own in properties.items()
    }


def _stamp(own: Mapping[str, Any]) -> Fraction | None:
    """Start time [s]; None where it is not stated, as a time of 0 is what nobody has set."""
    stamp = own.get("wf_start_time")
    if not (seconds := getattr(stamp, "seconds", 0)):
        return None
    return Fraction(seconds) + Fraction(getattr(stamp, "second_fractions", 0), FRACTIONS)


def _increment(own: Mapping[str, Any]) -> float | None:
    """Sample time that a channel states [s]; None where ``wf_increment`` is no step in time."""
    step = _number(own.get("wf_increment"))
    return step if step is not None and step > 0.0 and 1.0 / step < np.inf else None


def _number(value: Any) -> float | None:
    """A finite number, or None."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
    return float(value) if is_number else None
