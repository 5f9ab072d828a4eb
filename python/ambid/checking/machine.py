"""Does y follow the current as in the nominal machine, and is this the machine of the rig file?

Another machine and physics that takes force look alike in one record: both leave the shape of the response and change
its size. What tells them apart is the controller's equation, which physics in the machine leaves as it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.checking.equations import correlation, exchanged_axes, expected_displacement, gain_of
from ambid.checking.nominal import Lines, NominalLoop
from ambid.checking.soundness import FORCE, Finding
from ambid.record import Record

__all__ = ["TURNED", "renamed", "slips_of_machine"]

NOMINAL = 0.8
"""Correlation with the nominal response from which on its size must be right; hidden lags of a sample leave 0.6."""
OPPOSITE = -0.6
"""Correlation with the nominal response below which the sign of y is wrong."""
SMALLEST, LARGEST = 0.6, 1.7
"""Size over that of the nominal response, beyond which it is another machine where nothing physical takes or gives so
much. Dead band, friction and hysteresis take any part of the force of a small current; no effect adds to it."""
TURNED = "map it with a factor -1 (y and r grow along the force of a positive i_c)"


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
    cause = "i_c as in the nominal machine" if record.i_c is not None else "i_e as in the nominal loop"
    found, where = [], record.name
    if alike < 0.9 or gain.min() < 0.75 or gain.max() > 1.35:
        # a low correlation may be noise; a wrong size or sign of what is like the nominal response is not
        size = float(np.median(gain))
        is_small = alike > NOMINAL and size <= SMALLEST
        other = alike < OPPOSITE or (alike > NOMINAL and size >= LARGEST) or (is_small and not is_rig_right)
        severe = bool(other and (record.i_c is not None or loop.gain_factor == 1.0))
        what = f"y follows {cause} with a gain of {gain.min():.2f} to {gain.max():.2f} and a correlation of "
        what += f"{alike:.2f}, expected 0.75 to 1.35 and more than 0.9"
        todo = "is this a record of another rig, or another bias current? Check mass, K_i, K_s and sensor scales"
        if is_small and not severe:
            where = f"{record.name}: {FORCE}"
            todo = "check mass, K_i, K_s, bias current and sensor scales; if they are right, physics takes force (a "
            todo += "dead band, friction, hysteresis), and a record with more excitation has a larger gain"
        if alike < OPPOSITE:
            what = f"y follows {cause} with a correlation of {alike:.2f}, expected more than 0.9"
            todo = f"the sign of y is opposite: {TURNED}, and r with it if it is read in the same way"
        found.append(Finding("fault" if severe else "warning", where, what, todo, stops_diagnosis=severe))
    order, ratio = exchanged_axes(loop, lines)
    if ratio < 0.6:
        what = f"the nominal machine misses y by {100 * (1 - ratio):.0f} % less with {renamed(record, order)}"
        found.append(Finding("warning", record.name, what, "check the names of the axes, and which bearing is which"))
    return found


def renamed(record: Record, order: Sequence[int]) -> str:
    """Which axis is to be called which, for a message."""
    pairs = [f"{record.axes[k]} as {record.axes[j]}" for j, k in enumerate(order) if j != k]
    return ", ".join(pairs)
