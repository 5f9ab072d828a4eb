"""Signals that are too large or too small by the factor of a unit."""

from __future__ import annotations

from collections.abc import Sequence

from ambid.findings import Finding, Kind, Where
from ambid.record import Record

SLIPS = (-1.0, 1e3, 1e-3, 1e6, 1e-6)
"""Factors by which a sign or a unit goes wrong."""
UNITS = {("y", 1e3): "mm", ("y", 1e6): "um", ("i_e", 1e3): "mA", ("i_c", 1e3): "mA", ("i_c", 1e6): "uA"}

WRONG_UNIT = Kind(
    "wrong_unit",
    "error",
    "{signal} on {axes} has {factor:g} times the size that follows from the {reference}[: it appears to be in {unit}]",
    "give SI units, A and m",
)


def wrong_unit(record: Record, signal: str, axes: Sequence[str], factor: float, reference: str) -> Finding:
    """A signal that is too large by a positive factor of `SLIPS`, on these axes, by that which it is held against."""
    return WRONG_UNIT(
        Where(record=record.name, channel=signal),
        signal=signal,
        axes=list(axes),
        factor=factor,
        reference=reference,
        unit=UNITS.get((signal, factor)),
    )
