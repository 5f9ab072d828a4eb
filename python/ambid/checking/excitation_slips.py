"""Is the recorded excitation the one that drove the loop; without i_c, does y follow it as in the nominal loop?"""

from typing import Any

import numpy as np

from ambid.checking.equations import (
    best_order,
    best_shift,
    called_for,
    chance,
    correlation,
    expected_displacement,
    gain_of,
)
from ambid.checking.lines import Lines
from ambid.checking.machine import taken_as
from ambid.checking.nominal import NominalLoop
from ambid.checking.signs import SLIPS, opposite_sign, wrong_unit
from ambid.findings import Finding, Kind, Where
from ambid.record import Record

ALIKE = 0.5
"""Correlation above which two signals have to do with each other."""

_AS_IT_IS = "what drove the loop correlates with i_e by {correlation:.2f} as it is"
EXCITATION_DOUBTFUL = Kind(
    "excitation_doubtful",
    "warning",
    "what drove the loop correlates with i_e by {correlation:.2f} only",
    "raise the excitation above the noise, and check that i_e and i_c are those of this loop",
)
EXCITATION_ORDER = Kind(
    "excitation_axes_exchanged",
    "error",
    _AS_IT_IS + ", by {correlation_exchanged:.2f} with {columns} taken as {axes}",
    "correct the axes of i_e, or of y",
)
EXCITATION_SHIFTED = Kind(
    "excitation_shifted",
    "error",
    _AS_IT_IS + ", by {correlation_shifted:.2f} when it is shifted by {shift_samples:+d} samples "
    "({shift_s:+.4g|ms}; positive: to later times)",
    "align i_e with y; it may be that of another record with the same sequence",
)
FOREIGN_EXCITATION = Kind(
    "foreign_excitation",
    "error",
    _AS_IT_IS + ": it seems to belong to another record",
    "give the i_e of this record",
)


def slips_of_closed_loop(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """Without i_c: y follows i_e as in the nominal closed loop."""
    expected = expected_displacement(loop, lines)
    alike = correlation(lines.y, expected)
    if alike < -ALIKE:
        return [opposite_sign(record, "y", correlation=alike)]
    if alike < ALIKE:
        return slips_of_excitation(record, loop, lines)
    gain = float(np.median(gain_of(lines.y, expected)))
    factor = next((f for f in SLIPS if 0.4 < gain / f < 2.5), None)
    return [] if factor is None else [wrong_unit(record, "y", record.axes, factor, "nominal loop")]


def slips_of_excitation(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """The recorded i_e is the one that drove the loop; it is not only where half of its part would have shown."""
    wanted, given = called_for(loop, lines)
    alike, where = correlation(wanted, given), Where(record=record.name, channel="i_e")
    if alike > ALIKE:
        return [EXCITATION_DOUBTFUL(where, correlation=alike)]
    order = best_order(wanted, given)
    if (ordered := correlation(wanted, given[:, order])) > ALIKE:
        columns = taken_as(record, order)
        return [EXCITATION_ORDER(where, correlation=alike, correlation_exchanged=ordered, **columns)]
    by_chance = chance(wanted, given)
    shift, height = best_shift(wanted, given, lines)
    if height > max(ALIKE, 5.0 * by_chance):  # the best of many shifts
        values: dict[str, Any] = {"shift_samples": shift, "shift_s": shift / record.sample_rate}
        return [EXCITATION_SHIFTED(where, correlation=alike, correlation_shifted=height, **values)]
    part = float(np.linalg.norm(given) / np.linalg.norm(wanted))  # the correlation of i_e with itself beside noise
    if alike > 3.0 * by_chance or 0.5 * min(part, 1.0) < 3.0 * by_chance:
        return [EXCITATION_DOUBTFUL(where, correlation=alike)]
    return [FOREIGN_EXCITATION(where, correlation=alike)]
