"""What a record of several periods lets one mend, told sample by sample: the other periods know better."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ambid.record.raw import SIGNALS
from ambid.record.repeats import Repeats, repeats
from ambid.record.spikes import without_spikes

if TYPE_CHECKING:
    from ambid.record.record import Record

__all__ = ["mended_excitation", "mended_outputs"]

TOLD = 3
"""Samples of a channel that are told one by one."""
ENOUGH = 3
"""Periods in one piece that are enough, so that no rows need be joined."""
AROUND = 50
"""Rows before the place of a loss that go with it: it is known to a hold of the excitation."""


def mended_excitation(record: Record) -> tuple[Record, list[str]]:
    """A record whose logged i_e does not repeat throughout, with its period: wrong samples mended, lost rows cut away.

    Parameters
    ----------
    record : Record
        With i_e, without a period.

    Returns
    -------
    record : Record
        As it was, where no period explains most of i_e.
    notes : list of str
    """
    found = repeats(np.asarray(record.i_e))
    if found is None:
        return record, []
    record, notes = _right(record, found)
    if found.steps:
        record, more = _without_losses(record, found)
        notes += more
    return replace(record, period=found.period), notes


def _right(record: Record, found: Repeats) -> tuple[Record, list[str]]:
    """Single wrong samples of i_e as a period before and after."""
    i_e, notes = np.array(record.i_e), []
    for row, axis in found.wrong.tolist():
        others = [i_e[k, axis] for k in (row - found.period, row + found.period) if 0 <= k < len(i_e)]
        usual = float(np.mean(others))
        notes.append(
            f"i_e.{record.axes[axis]} is {i_e[row, axis]:.6g} A in row {row + 1}, a period from there {usual:.6g} A: "
            "a wrong sample of the log, taken as the latter"
        )
        i_e[row, axis] = usual
    if len(notes) > TOLD:
        notes = [*notes[:TOLD], f"{len(notes) - TOLD} more wrong samples of i_e, likewise"]
    if not notes and not found.steps:
        apart = i_e[found.period :] - i_e[: -found.period]
        noise = float(np.max(apart.std(axis=0) / i_e.std(axis=0))) / np.sqrt(2.0)
        notes = [f"i_e repeats after {found.period} samples but for {100.0 * noise:.2g} % of noise"]
    return replace(record, i_e=i_e), notes


def _without_losses(record: Record, found: Repeats) -> tuple[Record, list[str]]:
    """The longest piece between losses; where it is short, all pieces, joined at the same place of a period."""
    edges = [0, *(step.row for step in found.steps), record.samples]
    k = int(np.argmax(np.diff(edges)))
    kept = np.arange(edges[k], edges[k + 1])
    left = f"rows {kept[0] + 1} to {kept[-1] + 1} of {record.samples} are judged, the rest is left out"
    if len(kept) < ENOUGH * found.period:
        mask = np.ones(record.samples, dtype=bool)
        for step in found.steps:
            first = max(0, step.row - AROUND)
            mask[first : first + found.period - step.lost] = False
        kept = np.flatnonzero(mask)
        left = f"a period around is left out, and {len(kept)} of {record.samples} rows are judged"
    what = [
        f"{abs(step.lost)} row{'s' if abs(step.lost) > 1 else ''} {'lost' if step.lost > 0 else 'repeated'} near row "
        f"{step.row + 1}, from where on i_e is {'ahead of' if step.lost > 0 else 'behind'} its sequence"
        for step in found.steps
    ]
    signals = {name: None if (own := getattr(record, name)) is None else own[kept] for name in SIGNALS}
    return replace(record, **signals), [f"{'; '.join(what)}: {left}"]


def mended_outputs(record: Record) -> tuple[Record, list[str]]:
    """A record without spikes: single samples of y and i_c that no other period has.

    Parameters
    ----------
    record : Record
        Left as it is without three periods.
    """
    if record.period is None or record.periods < 3:
        return record, []
    notes, mended = [], {}
    for signal in ("y", "i_c"):
        columns = getattr(record, signal)
        if columns is None:
            continue
        for j, axis in enumerate(record.axes):
            cleaned, rows = without_spikes(columns[:, j], record.period)
            if not len(rows):
                continue
            mended.setdefault(signal, columns.copy())[:, j] = cleaned
            unit = "m" if signal == "y" else "A"
            told = [f"row {k + 1}: {columns[k, j]:.4g} {unit} for {cleaned[k]:.4g}" for k in rows[:TOLD].tolist()]
            more = f" and {len(rows) - TOLD} more" if len(rows) > TOLD else ""
            notes.append(
                f"{signal}.{axis} has {len(rows)} spike{'s' if len(rows) > 1 else ''} that no other period has "
                f"({', '.join(told)}{more}): left out, what the other periods have there is taken"
            )
    return (replace(record, **mended) if mended else record), notes
