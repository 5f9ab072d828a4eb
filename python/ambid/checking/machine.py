"""Does y follow the current as in the nominal machine, and is this the machine of the rig file?

Another machine and physics that takes force look alike in one record: both leave the shape of the response and change
its size. What distinguishes them is the controller's equation, which physics in the machine leaves as it is.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ambid.checking.equations import correlation, exchanged_axes, expected_displacement, gain_of
from ambid.checking.lines import Lines
from ambid.checking.nominal import NominalLoop
from ambid.checking.signs import opposite_sign
from ambid.findings import Finding, Kind, Where
from ambid.record import Record

NOMINAL = 0.8
"""Correlation with the nominal response from which on its size must be right; hidden lags of a sample leave 0.6."""
OPPOSITE = -0.6
"""Correlation with the nominal response below which the sign of y is wrong."""
SMALLEST, LARGEST = 0.6, 1.7
"""Size over that of the nominal response, beyond which it is another machine where nothing physical takes or gives so
much. Dead band, friction and hysteresis take any part of the force of a small current; no effect adds to it."""

_UNLIKE = (
    "y follows {cause} with {lowest_gain:.2f} to {highest_gain:.2f} times the response of the nominal {model} and a "
    "correlation of {correlation:.2f}, expected 0.75 to 1.35 and more than 0.9"
)
OTHER_MACHINE = Kind(
    "other_machine",
    "error",
    _UNLIKE,
    "is this a record of another rig, or another bias current? Check mass, K_i, K_s and sensor scales",
)
PLANT_DIFFERS = Kind("plant_differs", "warning", _UNLIKE, OTHER_MACHINE.remedy)
FORCE_TOO_SMALL = Kind(
    "force_too_small",
    "warning",
    _UNLIKE,
    "check mass, K_i, K_s, bias current and sensor scales; if they are right, physics reduces the force (a dead band, "
    "friction, hysteresis), and a record with more excitation has a larger gain",
)
"""A diagnosis may take it for a small K_i."""
AXES_EXCHANGED = Kind(
    "axes_exchanged",
    "warning",
    "the nominal machine misses {reduction:.0f|%} less of y with {columns} taken as {axes}",
    "check the names of the axes, and which bearing is which",
)


def slips_of_machine(record: Record, loop: NominalLoop, lines: Lines, *, is_rig_right: bool) -> list[Finding]:
    """y follows the current as in the nominal machine; without i_c, it follows i_e as in the nominal loop.

    Parameters
    ----------
    record : Record
    loop : NominalLoop
    lines : Lines
        Of the record.
    is_rig_right : bool
        Whether i_c follows the rig's controller, so that the record is of this rig: a y that is too small is then a
        matter of K_i or of physics, and no diagnosis stops for it.
    """
    expected = expected_displacement(loop, lines)
    alike, gain = correlation(lines.y, expected), gain_of(lines.y, expected)
    found = []
    limit = 0.9
    if not lines.whole_periods:  # what does not go with the nominal response may be noise, which only periods show
        limit, gain = OPPOSITE, gain * abs(alike)
        if OPPOSITE < alike < NOMINAL:
            gain = np.ones(1)
    if alike < limit or gain.min() < 0.75 or gain.max() > 1.35:
        # a low correlation may be noise; a wrong size or sign of what is like the nominal response is not
        size = float(np.median(gain))
        is_small = alike > NOMINAL and size <= SMALLEST
        other = alike < OPPOSITE or (alike > NOMINAL and size >= LARGEST) or (is_small and not is_rig_right)
        severe = bool(other and (record.i_c is not None or loop.gain_factor == 1.0))
        kind = OTHER_MACHINE if severe else FORCE_TOO_SMALL if is_small else PLANT_DIFFERS
        if alike < OPPOSITE:
            found.append(opposite_sign(record, "y", correlation=alike, is_certain=severe))
        else:
            has_i_c = record.i_c is not None
            found.append(
                kind(
                    Where(record=record.name, channel="y"),
                    cause="i_c" if has_i_c else "i_e",
                    model="machine" if has_i_c else "loop",
                    lowest_gain=float(gain.min()),
                    highest_gain=float(gain.max()),
                    correlation=alike,
                )
            )
    order, ratio = exchanged_axes(loop, lines)
    if ratio < 0.6:
        found.append(AXES_EXCHANGED(Where(record=record.name), reduction=1.0 - ratio, **taken_as(record, order)))
    return found


def taken_as(record: Record, order: Sequence[int]) -> dict[str, Any]:
    """Values of a finding: the columns that are to be taken for other axes, and for which."""
    moved = [(k, j) for j, k in enumerate(order) if j != k]
    return {"columns": [record.axes[k] for k, _ in moved], "axes": [record.axes[j] for _, j in moved]}
