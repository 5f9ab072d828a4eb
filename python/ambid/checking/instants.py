"""Were y, i_c and i_e read at the instants that the file says, by one clock and without gaps?"""

from typing import Any

import numpy as np

from ambid.checking.clocks import Clock, out_of_step
from ambid.checking.controller import current_late, read_late
from ambid.checking.lines import Lines
from ambid.checking.nominal import NominalLoop
from ambid.findings import Finding, Kind, Where
from ambid.record import Record

CLOCK_DIFFERENCE = Kind(
    "clock_difference",
    "error",
    "the clock of y differs from that of i_e by {difference:+.3g|ppm} (positive: faster), {shift_samples:.2g} samples "
    "over the record",
    "give all cards one clock, or resample y and i_c to that of i_e",
)
SAMPLES_LOST = Kind(
    "samples_lost",
    "error",
    "{samples} sample(s) lost near row {row}, and not of i_e",
    "cut the record there, or record again: what comes after belongs to another instant",
)
SAMPLES_REPEATED = Kind(
    "samples_repeated",
    "error",
    "{samples} sample(s) repeated near row {row}, and not of i_e",
    "cut the record there, or record again: what comes after belongs to another instant",
)
CHANNEL_DELAY = Kind(
    "channel_delay",
    "error",
    "{signal} on {axes} appears sampled {delay_s:.3g|us} ({delay_samples:.3g} samples) after {reference}, by the "
    "controller's equation with its nominal gains or any others",
    "shift {signal} by that time, or give all cards one trigger; a controller that is not the rig's may be the cause",
)
CURRENT_AHEAD = Kind(
    "current_ahead",
    "warning",
    "i_c on {axes} is {advance_s:.3g|us} ({advance_samples:.3g} samples) ahead of what the rig's controller makes of y "
    "and i_e: it appears sampled that much after y",
    "shift i_c to times later by {advance_s:.3g|us}, or give all cards one trigger; or the rig's delay is too long",
)
"""No physics of a machine brings a current early."""
CURRENT_BEHIND = Kind(
    "current_behind",
    "note",
    "i_c on {axes} comes {delay_s:.3g|us} ({delay_samples:.3g} samples) after what the rig's controller makes of y and "
    "i_e",
    "the loop or its amplifier is slower, or i_c was sampled early: a diagnosis determines by y which",
)


def slips_of_clocks(record: Record, loop: NominalLoop) -> list[Finding]:
    """y keeps in step with the excitation."""
    found = []
    for own in out_of_step(record, loop):
        if isinstance(own, Clock):
            where, shift = Where(record=record.name, channel="y"), abs(own.fast) * record.samples
            found.append(CLOCK_DIFFERENCE(where, difference=own.fast, shift_samples=shift))
            continue
        kind = SAMPLES_LOST if own.samples > 0 else SAMPLES_REPEATED
        where = Where(record=record.name, channel=f"y.{record.axes[own.axis]}")
        found.append(kind(where, samples=abs(own.samples), row=own.row + 1))
    return found


def slips_of_instants(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """y, i_c and i_e are read when the file says; where i_e is rebuilt from them, nothing shows it."""
    if record.is_rebuilt:
        return []
    found = read_late(loop, lines)
    if found is None:
        return _currents(record, loop, lines)
    late = np.flatnonzero(found.seconds)
    seconds = float(np.median(found.seconds[late]))
    is_of_i_e = np.abs(found.current[late] + found.seconds[late]).max() < 0.2 * abs(seconds)
    signal, reference = ("i_e", ["y", "i_c"]) if is_of_i_e else ("y", ["i_e"])
    return [
        CHANNEL_DELAY(
            Where(record=record.name, channel=signal),
            signal=signal,
            axes=[record.axes[k] for k in late],
            reference=reference,
            delay_s=seconds,
            delay_samples=seconds * record.sample_rate,
        )
    ]


def _currents(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """i_c comes when the rig's controller and delay bring it; no loop brings it earlier."""
    late, findings = current_late(loop, lines), []
    for sign, kind, name in ((-1.0, CURRENT_AHEAD, "advance"), (1.0, CURRENT_BEHIND, "delay")):
        own = np.flatnonzero(sign * late > 0.0)
        if not own.size:
            continue
        seconds = float(np.median(np.abs(late[own])))
        values: dict[str, Any] = {f"{name}_s": seconds, f"{name}_samples": seconds * record.sample_rate}
        where = Where(record=record.name, channel="i_c")
        findings.append(kind(where, axes=[record.axes[k] for k in own], **values))
    return findings
