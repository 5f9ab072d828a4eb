"""Were y, i_c and i_e read at the instants that the file says, by one clock and without gaps?"""

from __future__ import annotations

import numpy as np

from ambid.checking.clocks import Clock, out_of_step
from ambid.checking.controller import current_late, read_late
from ambid.checking.nominal import Lines, NominalLoop
from ambid.checking.soundness import INSTANT, Finding
from ambid.record import Record

__all__ = ["slips_of_clocks", "slips_of_instants"]


def slips_of_clocks(record: Record, loop: NominalLoop) -> list[Finding]:
    """y keeps in step with the excitation."""
    found, todo = [], "cut the record there, or record again: what comes after belongs to another instant"
    for own in out_of_step(record, loop):
        if isinstance(own, Clock):
            what = f"runs {1e6 * abs(own.fast):.3g} ppm {'slower' if own.fast < 0.0 else 'faster'} than that of i_e: "
            what += f"{abs(own.fast) * record.samples:.2g} samples over the record"
            clock = "give all cards one clock, or resample y and i_c to that of i_e"
            found.append(Finding.fault(f"{record.name}: y", f"the clock of y {what}", clock))
            continue
        count = f"{abs(own.samples)} sample{'s' if abs(own.samples) > 1 else ''}"
        what = f"{count} {'lost' if own.samples > 0 else 'repeated'} near row {own.row + 1}, and not of i_e"
        found.append(Finding.fault(f"{record.name}: y.{record.axes[own.axis]}", what, todo))
    return found


def slips_of_instants(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """y, i_c and i_e are read when the file says."""
    found = read_late(loop, lines)
    if found is None:
        return _currents(record, loop, lines)
    late = np.flatnonzero(found.seconds)
    seconds, axes = float(np.median(found.seconds[late])), ", ".join(record.axes[k] for k in late)
    samples = abs(seconds) * record.sample_rate
    how = f"{samples:.3g} sample{'' if samples <= 1.0 else 's'} ({1e6 * abs(seconds):.3g} us)"
    how += f" {'late' if seconds > 0.0 else 'early'}"
    if np.abs(found.current[late] + found.seconds[late]).max() < 0.2 * abs(seconds):
        what, todo = f"i_e was logged {how} against y and i_c", "move i_e, or give its card the trigger of the others"
        return [Finding.fault(f"{record.name}: i_e on {axes}", what, todo)]
    what = f"read {how} against i_e, by the controller's equation with its nominal gains or any others"
    todo = "move y by that time, or give all cards one trigger; a controller that is not the rig's may be a cause, too"
    return [Finding.fault(f"{record.name}: y on {axes}", what, todo)]


def _currents(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """i_c comes when the rig's controller and delay bring it; no loop brings it earlier."""
    late = current_late(loop, lines)
    if late is None or record.is_rebuilt:
        return []
    findings, made = [], "what the rig's controller makes of y and i_e"
    for sign in (-1.0, 1.0):
        own = np.flatnonzero(sign * late > 0.0)
        if not own.size:
            continue
        seconds = float(np.median(np.abs(late[own])))
        where = f"{record.name}: i_c on {', '.join(record.axes[k] for k in own)}: {INSTANT}"
        samples = seconds * record.sample_rate
        how = f"{samples:.3g} sample{'s' if samples > 1.005 else ''} ({1e6 * seconds:.3g} us)"
        if sign < 0.0:
            todo = f"move i_c to times later by {how}, or give all cards one trigger; or the rig's delay is too long"
            findings.append(Finding("warning", where, f"{how} ahead of {made}: read that much after y", todo))
        else:
            todo = "the loop or its amplifier is slower, or i_c was read early: a diagnosis tells by y which"
            findings.append(Finding("note", where, f"{how} after {made}", todo))
    return findings
