"""Signals of the opposite sign, or in another unit, than the controller's equation or the machine shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ambid.checking.controller import fit_controller
from ambid.checking.lines import Lines
from ambid.checking.nominal import NominalLoop
from ambid.findings import Finding, Kind, Where
from ambid.record import Record

UNEXPLAINED = 0.4
"""Part of i_c, by rms, that the controller's equation may miss before a wrong column or excitation is sought."""

_OPPOSITE = (
    "the sign of {signals}[ on {axes}] appears opposite[: a correlation of {correlation:.2f} with the response of the "
    "nominal machine][: the controller's equation misses {missed:.0f|%} of i_c as it is, and {missed_turned:.0f|%} "
    "with {signals} turned]"
)
OPPOSITE_SIGN = Kind(
    "opposite_sign",
    "error",
    _OPPOSITE,
    "map it with a factor -1 (y and r grow along the force of a positive i_c, i_c along a positive i_e); if both y "
    "and r were read that way, map both, or turn the controller in the rig",
)
POSSIBLY_OPPOSITE_SIGN = Kind("possibly_opposite_sign", "warning", _OPPOSITE, OPPOSITE_SIGN.remedy)
"""Where the nominal loop is unstable, which y is held against."""
SLIPS = (-1.0, 1e3, 1e-3, 1e6, 1e-6)
"""Factors by which a sign or a unit goes wrong."""
UNITS = {("y", 1e3): "mm", ("y", 1e6): "um", ("i_e", 1e3): "mA", ("i_c", 1e3): "mA", ("i_c", 1e6): "uA"}

WRONG_UNIT = Kind(
    "wrong_unit",
    "error",
    "{signal} on {axes} has {factor:g} times the size that follows from the {reference}[: it appears to be in {unit}]",
    "give SI units, A and m",
)


def opposite_sign(
    record: Record,
    *signals: str,
    axes: Sequence[str] = (),
    correlation: float | None = None,
    missed: float | None = None,
    missed_turned: float | None = None,
    is_certain: bool = True,
) -> Finding:
    """The sign of these signals is opposite, of all axes or some, as far as figures show it."""
    return (OPPOSITE_SIGN if is_certain else POSSIBLY_OPPOSITE_SIGN)(
        Where(record=record.name, channel=signals[0] if len(signals) == 1 else ""),
        signals=list(signals),
        axes=list(axes) or None,
        correlation=correlation,
        missed=missed,
        missed_turned=missed_turned,
    )


def turned(record: Record, loop: NominalLoop, lines: Lines, missed: float) -> list[Finding]:
    """y, r or both whose sign, turned, lets a controller that acts on them explain i_c; nothing where none does."""
    if not lines.r.any():
        return []
    ways = {
        ("y",): replace(lines, y=-lines.y),
        ("r",): replace(lines, r=-lines.r),
        ("y", "r"): replace(lines, y=-lines.y, r=-lines.r),
    }
    left = {signals: float(np.median(fit_controller(loop, own).missed)) for signals, own in ways.items()}
    signals = min(left, key=lambda own: left[own])
    if left[signals] > min(0.5 * missed, UNEXPLAINED):
        return []
    return [opposite_sign(record, *signals, missed=missed, missed_turned=left[signals])]


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
