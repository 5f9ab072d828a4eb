"""What drives a record: the reference, the excitation, logged, applied or rebuilt, its period, what is mended by it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambid.errors import RecordError
from ambid.findings import Finding, Kind, Where
from ambid.record import checks
from ambid.record.free_modes import REBUILT_TOLERANCE, is_held
from ambid.record.mending import FEWEST, mended_excitation, mended_outputs
from ambid.record.raw import OF_LOOP, Signals
from ambid.record.rebuild import ExcitationSource, rebuild_excitation, rounding_of, steps_of, unexplained
from ambid.record.repeats import find_period, mismatches
from ambid.rig import Rig

APPLIED = Kind(
    "excitation_as_applied",
    "note",
    "i_e is what was applied: the recorded command follows from y, the logged i_e and the rig's controller, but was "
    "clipped",
)
COMMAND_UNEXPLAINED = Kind(
    "command_unexplained",
    "warning",
    "no sum of i_e and the law of the rig's controller: {share:.2g|%} of its changes from sample to sample are left, "
    "up to {limit:g|%} expected; i_e is taken as logged",
    "see [controller], its delay, and the columns of i_e and i_ref",
)
SPENT = Kind(
    "current_left_out",
    "note",
    "i_c is left out: i_e was rebuilt from it and explains all of it, so that only y is used",
)
FREE = Kind(
    "comes_to_rest",
    "note",
    "i_e was not logged: taken as zero: y decays, r is constant, and i_c follows without an excitation",
)
UNKNOWN = Kind(
    "excitation_unknown", "warning", "i_e was not logged", "load the record with its rig, whose controller rebuilds it"
)
REFERENCE_DRIVES = Kind(
    "reference_drives", "note", "i_e was not logged: taken as zero, the reference r drives the loop"
)
NOT_REBUILT = Kind(
    "excitation_not_rebuilt",
    "note",
    "i_e was not logged: taken as zero; r is constant, and no i_ref or i_c was recorded to rebuild i_e from",
)
REFERENCE_LEFT_OUT = Kind(
    "reference_left_out",
    "warning",
    "r was recorded, but the rig's controller does not act on it (reference is not true): left out",
)
NO_PERIOD = Kind(
    "no_period_found",
    "note",
    "no period of {signals} found: a noise ceiling from repeats needs {needed}; without, it is that of the noise model",
)
FEW_PERIODS = Kind(
    "few_periods_found",
    "note",
    "{periods} whole periods of {signals} found: a noise ceiling from repeats needs {needed}; without, it is that of "
    "the noise model",
)
LAWFUL = 0.99
"""Part of the samples off the limits of a command in which it must follow the law: only the limits differ then."""
ALIKE = 0.05
"""Part of the command's changes up to which the law counts as the one that made it."""


class Driven(NamedTuple):
    """The signals of a record once it is known what drives it, where i_e is from, samples per period, and findings."""

    signals: Signals
    source: ExcitationSource
    period: int | None
    findings: list[Finding]


def driven(
    where: str, rig: Rig | None, axes: tuple[str, ...], sample_rate: float, logged: Signals, stated: int | None
) -> Driven:
    """Find what drives a record.

    Parameters
    ----------
    where : str
        For the messages.
    rig : Rig, optional
        Its controller rebuilds i_e where that was not logged.
    axes : tuple of str
    sample_rate : float
        [Hz].
    logged : dict
        Arrays of shape (N, axes); they are not changed.
    stated : int, optional
        Samples per period, if it was stated.

    Raises
    ------
    RecordError
        If i_e cannot be rebuilt, nothing drives the loop, or the controller does not act on the reference that does.
    """
    signals, source, findings = _with_reference(where, rig, logged)
    period, is_known = stated, False
    if rig is not None and {"y", "i_e", "i_ref"} <= set(logged):
        applied, more = _applied(where, rig, sample_rate, signals)
        findings += more
        if applied is not None:
            signals, source, is_known = {**signals, "i_e": applied}, "applied_command", True
            period = stated or find_period(applied, tolerance=REBUILT_TOLERANCE)
    if "i_e" not in signals:
        if rig is None:
            return Driven(signals, "unknown", stated, [UNKNOWN()])
        _require_y(where, logged)
        try:
            i_e, period, source, how = rebuild_excitation(
                rig,
                sample_rate,
                y=logged["y"],
                i_ref=logged.get("i_ref"),
                i_c=logged.get("i_c"),
                r=logged.get("r"),
                period=stated,
                where=where,
            )
            is_free = _comes_to_rest(logged) and not (checks.decays(i_e) or _answers(logged["y"], i_e))
        except RecordError as error:
            if not _stands(logged):
                raise
            if not _comes_to_rest(logged):
                at = ", ".join(f"{value:.4g}" for value in logged["r"][0])
                why = str(error).removeprefix(f"{where}: ")
                raise RecordError(
                    f"{where}: what drives it is not known: i_e was not logged, r is constant ({at} m), and i_e is "
                    f"not rebuilt: {why}"
                ) from None
            is_free = True
        if is_free:
            i_e, period, source, how = np.zeros_like(logged["y"]), stated, "assumed_zero", (FREE(),)
        signals["i_e"] = i_e
        findings += how
        if "i_ref" not in logged and not is_free:
            signals.pop("i_c", None)
            findings.append(SPENT())
    i_e, r = signals["i_e"], signals.get("r")
    is_known |= "i_e" not in logged and bool(np.any(i_e))
    moved = [own for name, own in signals.items() if name == "y" or name not in OF_LOOP]
    findings += checks.findings_of_excitation(where, axes, signals.get("y", np.hstack(moved)), i_e, r)
    if is_known and "i_ref" in signals:
        findings += checks.findings_of_limits(axes, signals["i_ref"])
    drives = [s for s in (i_e, r) if s is not None and np.ptp(s, axis=0).max() >= checks.SMALLEST_CHANGE]
    found = period if is_known or not drives else find_period(_scaled(drives))
    what = "i_e repeats" if r is None else "what drives the loop repeats"
    if stated and drives and not is_known:
        _require_repeating(where, _scaled(drives), stated, found, what)
    period = period or found
    if found is None and not is_known and "i_e" in logged and drives and r is None:
        signals, mended, more = mended_excitation(signals, axes)
        period, findings = period or mended, [*findings, *more]
    periods = len(signals["i_e"]) // period if period else 0
    if period is not None and periods >= FEWEST:
        mended_signals, more = mended_outputs(signals, axes, period)
        signals, findings = mended_signals if more else signals, [*findings, *more]
    if periods < FEWEST:
        of = ["i_e"] if r is None else ["i_e", "r"]
        findings.append((FEW_PERIODS if period else NO_PERIOD)(periods=periods, signals=of, needed=FEWEST))
    return Driven(signals, source, period, findings)


def _applied(
    where: str, rig: Rig, sample_rate: float, logged: Signals
) -> tuple[NDArray[np.float64] | None, list[Finding]]:
    """Hold a recorded command against y, the rig's digital controller and a logged i_e.

    Where they differ at the command's highest and lowest values alone, it was clipped, and what was applied less what
    the law asks for is the excitation. Where they differ elsewhere, i_e stays as it was logged, and a finding says so.

    Returns
    -------
    i_e : ndarray, shape (N, axes), or None
        As applied; None where it stays as it was logged.
    findings : list of Finding
    """
    signals = {name: logged.get(name) for name in ("i_ref", "i_c", "r", "i_e")}
    i_e, i_ref = logged["i_e"], logged["i_ref"]
    if not rig.controller.is_digital:  # between the samples it follows y, which nobody recorded
        return None, []
    try:
        left = unexplained(rig, sample_rate, y=logged["y"], **signals, where=where)
    except RecordError:  # another rate, or a current that was not recorded
        return None, []
    late = len(i_ref) - len(left)
    command, rounding = i_ref[late:], rounding_of(i_ref)
    free = ~np.column_stack([checks.at_limits(own) for own in command.T])
    free[1:] &= free[:-1]
    held = is_held(left, rounding)
    if held.all():
        return None, []
    steps = steps_of(left, rounding) if held[free].mean() > LAWFUL else None
    if steps is not None and checks.findings_of_limits(rig.axes, i_ref):
        applied = i_e.copy()
        applied[: len(left)] += steps - np.median(steps, axis=0)
        return applied, [APPLIED()]
    changes = np.abs(np.where(free, np.diff(left, axis=0, prepend=left[:1]), 0.0))
    size = np.diff(command, axis=0).std(axis=0)
    missed = np.sqrt(np.mean(changes**2, axis=0)) / np.maximum(size, 1e-300)
    return None, [
        COMMAND_UNEXPLAINED(Where(channel=f"i_ref.{axis}"), share=float(part), limit=ALIKE)
        for axis, part in zip(rig.axes, missed, strict=True)
        if part > ALIKE
    ]


def _require_y(where: str, logged: Signals) -> None:
    """Refuse to rebuild i_e where there is no y that the controller acted on."""
    if "y" not in logged:
        raise RecordError(
            f"{where}: neither i_e nor y was recorded, from which i_e is rebuilt; record i_e or y as well"
        )


def _require_repeating(where: str, drives: NDArray[np.float64], stated: int, found: int | None, what: str) -> None:
    """Refuse a stated period after which what drives the loop does not repeat: all of it would be taken for noise."""
    fault = None
    if found and stated % found:
        fault, act = f"{what} after {found}", f"state {found} or a multiple of it, or leave it out"
    elif not found and stated <= len(drives) // 2 and mismatches(drives)[1][stated - 1] >= 1.0:
        # as of a signal with as much noise; by chance it is 1.41
        fault, act = f"{what} after that no better than by chance", "state the right one, or leave it out"
    if fault:
        raise RecordError(f"{where}: a period of {stated} samples was stated, but {fault}; {act}")


def _with_reference(where: str, rig: Rig | None, logged: Signals) -> tuple[Signals, ExcitationSource, list[Finding]]:
    """The signals as the rig's controller takes the reference; findings on one that does not act."""
    signals = dict(logged)
    if "r" not in logged or rig is None:
        return signals, "logged", []
    if not rig.controller.follows_reference:
        is_alone = "i_e" not in logged or not np.any(np.ptp(logged["i_e"], axis=0))
        if is_alone and np.any(np.ptp(logged["r"], axis=0)):
            raise RecordError(
                f"{where}: the reference r drives this record, but the rig's controller acts on y alone; write "
                "reference = true in [controller]"
            )
        del signals["r"]
        return signals, "logged", [REFERENCE_LEFT_OUT()]
    if "i_e" not in logged and "i_ref" not in logged and (_moves(logged["r"]) or "i_c" not in logged):
        signals["i_e"] = np.zeros_like(logged["r"])
        return signals, "assumed_zero", [REFERENCE_DRIVES() if _moves(logged["r"]) else NOT_REBUILT()]
    return signals, "logged", []


def _stands(logged: Signals) -> bool:
    """Whether there is a reference that does not move, and only a current shows whether anything drives the loop."""
    return "r" in logged and "i_ref" not in logged and not _moves(logged["r"])


def _comes_to_rest(logged: Signals) -> bool:
    """Whether, besides, y decays."""
    return _stands(logged) and checks.decays(logged["y"])


def _answers(y: NDArray[np.float64], i_e: NDArray[np.float64]) -> bool:
    """Whether y of an axis follows from the i_e before it, at the end of a record, by far more than chance."""
    rows = len(y) // 4
    lags = min(24, rows // 8)  # samples of i_e that y may follow from
    chance = lags / rows
    for own, drive in zip(y[-rows:].T, i_e.T, strict=True):
        own = own - own.mean()
        before = np.column_stack([drive[-rows - lag : -lag] for lag in range(1, lags + 1)])
        before -= before.mean(axis=0)
        left = own - before @ np.linalg.lstsq(before, own, rcond=None)[0]
        if 1.0 - np.sum(left**2) / max(float(np.sum(own**2)), 1e-300) > 4.0 * chance:
            return True
    return False


def _moves(signal: NDArray[np.float64]) -> bool:
    """Whether any axis of it changes."""
    return bool(np.any(np.ptp(signal, axis=0) >= checks.SMALLEST_CHANGE))


def _scaled(signals: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Signals of several units beside each other, each over the largest rms of its axes."""
    return np.hstack([s / s.std(axis=0).max() for s in signals])
