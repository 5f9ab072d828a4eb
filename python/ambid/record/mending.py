"""What a record of several periods lets one mend, sample by sample: the other periods know better.

Spikes are single samples of y and i_c that stand apart from the same samples of the other periods, as a card or cable
makes them. What differs from the median over the periods is held against the line between its neighbours, so that
drift, hum and a transient that dies away are none. A sample that stands out by far, alone, was not the machine's: its
loop would have answered.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.channels import SIGNALS, unit_of
from ambid.findings import Finding, Kind, Where
from ambid.record.frequency_gates import MOST_LISTED
from ambid.record.raw import Signals
from ambid.record.repeats import MOST_WRONG, OUTLIER, Repeats, repeats

WRONG_SAMPLE = Kind(
    "wrong_sample",
    "warning",
    "{logged_a:.6g} A in row {row}, a period from there {usual_a:.6g} A: a wrong sample of the log, taken as the "
    "latter",
)
WRONG_SAMPLES = Kind("wrong_samples", "warning", "{count} more wrong samples, likewise")
NOISY_EXCITATION = Kind("noisy_excitation", "note", "i_e repeats after {period} samples but for {share:.2g|%} of noise")
ROWS_LOST = Kind("rows_lost", "warning", "rows lost near row {row}: {count}; from there on it is ahead of its sequence")
ROWS_REPEATED = Kind(
    "rows_repeated", "warning", "rows repeated near row {row}: {count}; from there on it is behind its sequence"
)
PART_USED = Kind("part_used", "warning", "rows {first} to {last} of {samples} are used, the rest is left out")
PIECES_JOINED = Kind(
    "pieces_joined", "warning", "a period around each is left out, and {kept} of {samples} rows are used"
)
SPIKES = Kind(
    "spikes",
    "warning",
    "spikes that no other period has: {count}, in rows {rows} ({read:.4g} {unit}): left out, what the other periods "
    "have there is taken ({taken:.4g} {unit})",
)
FEWEST = 3
"""Periods that the noise is estimated from by themselves; a piece with as many needs no others joined to it."""
AROUND = 50
"""Rows around the place of a loss that go with it: it is known to a hold of the excitation."""
SURROUNDINGS = 100
"""Samples by which the deviation around a sample is judged. At a beginning at rest they are spared."""


def mended_excitation(
    signals: Mapping[str, FloatArray], axes: Sequence[str]
) -> tuple[Signals, int | None, list[Finding]]:
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
    findings : list of Finding
    """
    mended = dict(signals)
    found = repeats(mended["i_e"])
    if found is None:
        return mended, None, []
    mended["i_e"], findings = _right(mended["i_e"], axes, found)
    if found.steps:
        mended, more = _without_losses(mended, found)
        findings += more
    elif not findings:
        findings = [_noise(mended["i_e"], found.period)]
    return mended, found.period, findings


def _right(logged: FloatArray, axes: Sequence[str], found: Repeats) -> tuple[FloatArray, list[Finding]]:
    """Single wrong samples of i_e as a period before and after."""
    i_e, findings = logged.copy(), []
    for row, axis in found.wrong.tolist():
        others = [i_e[k, axis] for k in (row - found.period, row + found.period) if 0 <= k < len(i_e)]
        usual = float(np.mean(others))
        at = Where(channel=f"i_e.{axes[axis]}")
        findings.append(WRONG_SAMPLE(at, row=row + 1, logged_a=float(i_e[row, axis]), usual_a=usual))
        i_e[row, axis] = usual
    if len(findings) > MOST_LISTED:
        findings = [*findings[:MOST_LISTED], WRONG_SAMPLES(Where(channel="i_e"), count=len(findings) - MOST_LISTED)]
    return i_e, findings


def _noise(i_e: FloatArray, period: int) -> Finding:
    """How well a measured i_e repeats; it is taken as it is, so that the lines between show what its noise brings."""
    noise = float(np.max((i_e[period:] - i_e[:-period]).std(axis=0) / i_e.std(axis=0))) / np.sqrt(2.0)
    return NOISY_EXCITATION(period=period, share=noise)


def _without_losses(signals: Signals, found: Repeats) -> tuple[Signals, list[Finding]]:
    """The longest piece between losses; where it is short, all pieces, joined at the same place of a period."""
    samples = len(signals["i_e"])
    edges = [0, *(step.row for step in found.steps), samples]
    k = int(np.argmax(np.diff(edges)))
    first = edges[k] + (AROUND if k else 0)
    kept = np.arange(first, edges[k + 1] - (AROUND if edges[k + 1] < samples else 0))
    rest = PART_USED(first=int(kept[0]) + 1, last=int(kept[-1]) + 1, samples=samples)
    if len(kept) < FEWEST * found.period:
        mask = np.ones(samples, dtype=bool)
        for step in found.steps:
            first = max(0, step.row - AROUND)
            mask[first : first + found.period - step.lost] = False
        kept = np.flatnonzero(mask)
        rest = PIECES_JOINED(kept=len(kept), samples=samples)
    steps = [
        (ROWS_LOST if step.lost > 0 else ROWS_REPEATED)(Where(channel="i_e"), row=step.row + 1, count=abs(step.lost))
        for step in found.steps
    ]
    return {name: own[kept] for name, own in signals.items()}, [*steps, rest]


def mended_outputs(
    signals: Mapping[str, FloatArray], axes: Sequence[str], period: int
) -> tuple[Signals, list[Finding]]:
    """Signals without spikes: single samples of outputs that no other period has.

    Parameters
    ----------
    signals : mapping of str to ndarray of shape (N, axes)
        Of three periods or more.
    axes : sequence of str
    period : int
        In samples.
    """
    mended, findings = dict(signals), []
    for signal, columns in signals.items():
        if SIGNALS[signal.partition(".")[0]].path not in ("heard", "recorder"):
            continue
        for j, axis in enumerate(axes if "." not in signal else [""]):
            cleaned, rows = without_spikes(columns[:, j], period)
            if not len(rows):
                continue
            if mended[signal] is columns:
                mended[signal] = columns.copy()
            mended[signal][:, j] = cleaned
            spikes = SPIKES(
                Where(channel=f"{signal}.{axis}" if axis else signal),
                count=len(rows),
                rows=(rows + 1).tolist(),
                read=columns[rows, j].tolist(),
                taken=cleaned[rows].tolist(),
                unit=unit_of(signal),
            )
            findings.append(spikes)
    return mended, findings


def without_spikes(x: FloatArray, period: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """A channel with what the other periods and its neighbours say in place of single samples that stand apart.

    Parameters
    ----------
    x : ndarray, shape (N,)
        At least three whole periods.
    period : int
        In samples.

    Returns
    -------
    cleaned : ndarray, shape (N,)
    rows : ndarray of int
        Of the samples that were replaced; none where they are more than `MOST_WRONG`, beside each other, or a period
        apart.
    """
    rows: list[int] = []
    while (row := _worst(_apart(x, period, rows), rows)) is not None:
        if len(rows) == MOST_WRONG or row % period in {known % period for known in rows}:
            return x, np.zeros(0, dtype=np.intp)
        rows.append(row)
    found = np.unique(rows).astype(np.intp)
    if not len(found) or (len(found) > 1 and np.diff(found).min() < 3):
        return x, found[:0]
    apart, cleaned = _apart(x, period, rows), x.copy()
    cleaned[found] -= apart[found] - 0.5 * (apart[found - 1] + apart[found + 1])
    return cleaned, found


def _worst(apart: FloatArray, known: list[int]) -> int | None:
    """The row that stands out most from the line between its neighbours, if one does beside those known."""
    off = np.abs(apart[1:-1] - 0.5 * (apart[:-2] + apart[2:]))
    blocks = len(off) // SURROUNDINGS
    if blocks < 3:
        return None
    around = np.median(off[: blocks * SURROUNDINGS].reshape(blocks, -1), axis=1)
    around = np.maximum(np.maximum(around, np.roll(around, 1)), np.roll(around, -1))
    around = np.maximum(around, np.median(around)) / 0.6745
    rounding = np.finfo(float).eps * float(np.ptp(apart))
    block = np.minimum(np.arange(len(off)) // SURROUNDINGS, blocks - 1)
    ratio = off / np.maximum(around, rounding)[block]
    ratio[:SURROUNDINGS] = 0.0
    for row in known:
        ratio[row - 2 : row + 1] = 0.0
    row = int(np.argmax(ratio))
    return row + 1 if ratio[row] > OUTLIER else None


def _apart(x: FloatArray, period: int, without: list[int]) -> FloatArray:
    """What differs from the median over all whole periods, those rows aside."""
    whole = len(x) // period * period
    usual = np.median(x[:whole].reshape(-1, period), axis=0)
    for row in without:
        others = np.arange(row % period, whole, period)
        usual[row % period] = np.median(x[others[~np.isin(others, without)]])
    return x - np.resize(usual, len(x))
