"""What a record of several periods lets one mend, told sample by sample: the other periods know better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ambid.arrays import FloatArray
from ambid.record.repeats import Repeats, repeats
from ambid.record.spikes import without_spikes

Signals = dict[str, FloatArray]
"""Arrays (N, axes) by the names that a record gives them."""

__all__ = ["mended_excitation", "mended_outputs"]

TOLD = 3
"""Samples of a channel that are told one by one."""
ENOUGH = 3
"""Periods in one piece that are enough, so that no rows need be joined."""
AROUND = 50
"""Rows around the place of a loss that go with it: it is known to a hold of the excitation."""


def mended_excitation(signals: Mapping[str, FloatArray], axes: Sequence[str]) -> tuple[Signals, int | None, list[str]]:
    """Signals whose logged i_e does not repeat throughout: wrong samples mended, lost rows cut away.

    Parameters
    ----------
    signals : mapping of str to ndarray of shape (N, axes)
        With i_e.
    axes : sequence of str

    Returns
    -------
    signals : dict of str to ndarray
        As they were, where no period explains most of i_e.
    period : int or None
        In samples.
    notes : list of str
    """
    mended = dict(signals)
    found = repeats(mended["i_e"])
    if found is None:
        return mended, None, []
    mended["i_e"], notes = _right(mended["i_e"], axes, found)
    if found.steps:
        mended, more = _without_losses(mended, found)
        notes += more
    elif not notes:
        notes = [_noise(mended["i_e"], found.period)]
    return mended, found.period, notes


def _right(logged: FloatArray, axes: Sequence[str], found: Repeats) -> tuple[FloatArray, list[str]]:
    """Single wrong samples of i_e as a period before and after."""
    i_e, notes = logged.copy(), []
    for row, axis in found.wrong.tolist():
        others = [i_e[k, axis] for k in (row - found.period, row + found.period) if 0 <= k < len(i_e)]
        usual = float(np.mean(others))
        notes.append(
            f"i_e.{axes[axis]} is {i_e[row, axis]:.6g} A in row {row + 1}, a period from there {usual:.6g} A: "
            "a wrong sample of the log, taken as the latter"
        )
        i_e[row, axis] = usual
    if len(notes) > TOLD:
        notes = [*notes[:TOLD], f"{len(notes) - TOLD} more wrong samples of i_e, likewise"]
    return i_e, notes


def _noise(i_e: FloatArray, period: int) -> str:
    """How well a measured i_e repeats; it is taken as it is, so that the lines between show what its noise brings."""
    noise = float(np.max((i_e[period:] - i_e[:-period]).std(axis=0) / i_e.std(axis=0))) / np.sqrt(2.0)
    return f"i_e repeats after {period} samples but for {100.0 * noise:.2g} % of noise"


def _without_losses(signals: Signals, found: Repeats) -> tuple[Signals, list[str]]:
    """The longest piece between losses; where it is short, all pieces, joined at the same place of a period."""
    samples = len(signals["i_e"])
    edges = [0, *(step.row for step in found.steps), samples]
    k = int(np.argmax(np.diff(edges)))
    first = edges[k] + (AROUND if k else 0)
    kept = np.arange(first, edges[k + 1] - (AROUND if edges[k + 1] < samples else 0))
    left = f"rows {kept[0] + 1} to {kept[-1] + 1} of {samples} are judged, the rest is left out"
    if len(kept) < ENOUGH * found.period:
        mask = np.ones(samples, dtype=bool)
        for step in found.steps:
            first = max(0, step.row - AROUND)
            mask[first : first + found.period - step.lost] = False
        kept = np.flatnonzero(mask)
        left = f"a period around is left out, and {len(kept)} of {samples} rows are judged"
    what = [
        f"{abs(step.lost)} row{'s' if abs(step.lost) > 1 else ''} {'lost' if step.lost > 0 else 'repeated'} near row "
        f"{step.row + 1}, from where on i_e is {'ahead of' if step.lost > 0 else 'behind'} its sequence"
        for step in found.steps
    ]
    return {name: own[kept] for name, own in signals.items()}, [f"{'; '.join(what)}: {left}"]


def mended_outputs(signals: Mapping[str, FloatArray], axes: Sequence[str], period: int) -> tuple[Signals, list[str]]:
    """Signals without spikes: single samples of y and i_c that no other period has.

    Parameters
    ----------
    signals : mapping of str to ndarray of shape (N, axes)
        Of three periods or more.
    axes : sequence of str
    period : int
        In samples.
    """
    mended, notes = dict(signals), []
    for signal in ("y", "i_c"):
        columns = signals.get(signal)
        if columns is None:
            continue
        for j, axis in enumerate(axes):
            cleaned, rows = without_spikes(columns[:, j], period)
            if not len(rows):
                continue
            if mended[signal] is columns:
                mended[signal] = columns.copy()
            mended[signal][:, j] = cleaned
            unit = "m" if signal == "y" else "A"
            told = [f"row {k + 1}: {columns[k, j]:.4g} {unit} for {cleaned[k]:.4g}" for k in rows[:TOLD].tolist()]
            more = f" and {len(rows) - TOLD} more" if len(rows) > TOLD else ""
            notes.append(
                f"{signal}.{axis} has {len(rows)} spike{'s' if len(rows) > 1 else ''} that no other period has "
                f"({', '.join(told)}{more}): left out, what the other periods have there is taken"
            )
    return mended, notes
