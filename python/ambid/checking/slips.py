"""Is this rig and are these records sound, before anyone waits for a fit?

What is sought are slips of people: units, signs, columns, files that do not belong together, gains of another day.
Physics that the rig file does not know is no fault; to find it is the work of a diagnosis. A gain that is off by a
factor may be either: it is told here, and ranked there beside the physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.checking.controller import ControllerFit, fit_controller
from ambid.checking.equations import (
    FEWEST_LINES,
    best_order,
    best_shift,
    called_for,
    chance,
    controller_missed,
    correlation,
    expected_displacement,
    gain_of,
    reordered,
)
from ambid.checking.instants import slips_of_clocks, slips_of_instants
from ambid.checking.law import Law, find_laws
from ambid.checking.law_slips import slips_of_laws
from ambid.checking.machine import TURNED, renamed, slips_of_machine
from ambid.checking.nominal import HIGHEST_FREQUENCY, Lines, NominalLoop, moves
from ambid.checking.path import path
from ambid.checking.rig_slips import slips_of_rig
from ambid.checking.soundness import SEVERITIES, Finding, LoopFigures, RecordFigures, Severity, Soundness
from ambid.effects.slips import LEAST, MOST, ControllerGainError, ExcitationGainError
from ambid.errors import RecordError
from ambid.record import Record
from ambid.record.checks import decays, displacement
from ambid.results import speed_text
from ambid.rig import Rig, as_rig
from ambid.threads import with_one_blas_thread

__all__ = ["Finding", "LoopFigures", "RecordFigures", "Soundness", "check"]

ALIKE = 0.5
"""Correlation above which two signals have to do with each other."""
UNEXPLAINED = 0.4
"""Part of i_c, by rms, that the controller's equation may miss before a wrong column or excitation is sought."""
SLIPS = (-1.0, 1e3, 1e-3, 1e6, 1e-6)
"""Factors by which a sign or a unit goes wrong."""
UNITS = {("y", 1e3): "mm", ("y", 1e6): "um", ("i_e", 1e3): "mA", ("i_c", 1e3): "mA", ("i_c", 1e6): "uA"}
DOUBTFUL_GAIN, WRONG_GAIN = 0.02, 0.10
"""Relative error of a controller's gain, beyond five standard errors."""
CONTROLLER_SLIP, EXCITATION_SLIP = ControllerGainError.name, ExcitationGainError.name
HOLDS_BIAS = 0.1
"""Relative difference up to which a mean of i_c is the bias current itself: the whole current was recorded."""
WITHOUT_EXCITATION = 0.1
"""Factor of i_e in i_c up to which i_c was recorded before i_e joins it."""
ADD_EXCITATION = "it seems that i_c was recorded before i_e is added: record the current of the coil, or add i_e to i_c"
MOST_NAMED = 4
"""Axes that are named with a factor each."""
LEAST_SHARE = 0.02
"""Part of i_c that an error of a gain has to be to matter; an integral acts below most lines."""


@with_one_blas_thread
def check(rig: Rig | str | Path, records: Record | str | Path | Sequence[Record | str | Path] = ()) -> Soundness:
    """Hold a rig against itself, and records against the rig; nothing is fitted to be kept.

    Parameters
    ----------
    rig : Rig, or path of its file
    records : Record, path of its file, or sequence of them
        Loaded with this rig, or with that of the operating point that they state.

    Returns
    -------
    Soundness
        Findings, worst first, and the machine and the records in figures.
    """
    rig = as_rig(rig)
    several = (records,) if isinstance(records, Record | str | Path) else records
    loaded = [own if isinstance(own, Record) else Record.load(own, rig) for own in several]
    points = dict.fromkeys(record.point for record in loaded if record.point not in (None, rig))
    loops = {own: NominalLoop(own) for own in (rig, *(point for point in points if point is not None))}
    figures = LoopFigures.of(loops[rig])
    findings, described = [], []
    laws: dict[str, tuple[Law, ...]] = {}
    for own, loop in loops.items():
        of_rig = slips_of_rig(loop)
        findings += of_rig if own == rig else [replace(f, where=f"{own.path or own.name}: {f.where}") for f in of_rig]
    for record in loaded:
        own = rig if record.point is None else record.point
        foreign = _foreign(record, own)
        of_record = foreign or _record(record, loops[own])
        findings += of_record
        if not foreign:
            described.append(RecordFigures.of(record, own))
            stops = any(finding.stops_diagnosis for finding in of_record)
            if found := _laws(record, own):
                laws[record.name] = found
                findings += [] if stops else slips_of_laws(record.name, found)
            elif not stops:
                findings += _turned_reference(record, own)
    implementation = f"{rig.controller.implementation} {rig.controller.kind}"
    machine = (
        f"axes {', '.join(rig.axes)} at {rig.sample_rate:g} Hz, {speed_text(rig.speed)}, {implementation} controller"
    )
    ordered = sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))
    return Soundness(rig.name, machine, figures, tuple(described), tuple(ordered), laws)


def _laws(record: Record, rig: Rig) -> tuple[Law, ...]:
    """The law of each axis; none where the command cannot be held against the controller."""
    try:
        return find_laws(record, rig)
    except RecordError:  # another rate, or a current that was not recorded; told where it matters
        return ()


def _turned_reference(record: Record, rig: Rig) -> list[Finding]:
    """A reference whose sign, turned, shows the rig's law where the command follows none."""
    if record.r is None or not rig.controller.reference:
        return []
    turned = _laws(replace(record, r=-record.r), rig)
    if not turned or any(abs(law.factor - 1.0) > DOUBTFUL_GAIN for law in turned):
        return []
    what = "the command follows no law of y and r, and the rig's with r turned"
    return [Finding.fault(f"{record.name}: r", what, f"the sign of r is opposite: {TURNED}")]


def _foreign(record: Record, rig: Rig) -> list[Finding]:
    """The record has the rig's axes and rate, and an excitation; nothing else can be checked without."""
    todo = "load the record with its rig"
    if record.axes != rig.axes:
        return [Finding.fault(record.name, f"axes {', '.join(record.axes)}, the rig has {', '.join(rig.axes)}", todo)]
    if abs(record.sample_rate / rig.sample_rate - 1.0) > 1e-6:
        return [
            Finding.fault(record.name, f"{record.sample_rate:g} Hz, the rig samples at {rig.sample_rate:g} Hz", todo)
        ]
    if record.i_e is None:
        return [Finding.fault(record.name, "i_e was not logged", f"{todo}, whose controller rebuilds it")]
    if record.is_free_response and not decays(record.y):
        what = "i_e is" if record.r is None else "i_e and r are"
        return [Finding.fault(record.name, f"{what} constant on every axis: no excitation", "excite the loop")]
    return []


def _record(record: Record, loop: NominalLoop) -> list[Finding]:
    lines = Lines.of(record)
    found = [Finding("warning", record.name, note, "noted on loading; see that it is meant") for note in record.notes]
    found += [*_travel(record, loop.rig), *path(record), *_periods(record), *slips_of_clocks(record, loop)]
    if record.is_free_response:
        return found
    if not len(lines.index):
        what = f"no line of i_e between its first few and {HIGHEST_FREQUENCY:g} of the sample rate"
        return [*found, Finding("warning", record.name, what, "excite within the bandwidth of the loop")]
    is_held = lines.i_c is not None and len(lines.index) >= FEWEST_LINES
    if lines.i_c is not None and not is_held:
        what = f"{len(lines.index)} lines of i_e: the controller is held against the record from {FEWEST_LINES} on"
        found.append(Finding("warning", record.name, what, "excite more lines"))
    else:
        found += _closed_loop(record, loop, lines) if lines.i_c is None else _controller(record, loop, lines)
    faults = [finding for finding in found if finding.severity == "fault"]
    if any(finding.stops_diagnosis for finding in faults):
        return found
    return found + slips_of_machine(record, loop, lines, is_rig_right=is_held and not faults)


def _travel(record: Record, rig: Rig) -> list[Finding]:
    """Displacements fit into the air gap, currents below the bias; the worst axis of each is named."""
    bearings = [bearing for bearing in rig.bearings for _ in bearing.axes]
    gap, bias = np.array([(bearing.air_gap, bearing.bias_current) for bearing in bearings]).T
    rms, found = record.y.std(axis=0), []
    j, k = int(np.argmax(rms / gap)), int(np.argmin(rms))
    if rms[k] < 1e-12:
        what = f"rms {rms[k]:.3g} m, less than any sensor resolves"
        return [Finding.fault(f"{record.name}: y.{record.axes[k]}", what, "give metres")]
    begun = record.y if record.r is None else record.y - record.r[0]  # a set-point is no travel
    y = np.abs(displacement(begun, gap)).max(axis=0)
    j = int(np.argmax(y / gap))
    if y[j] > 0.5 * gap[j]:
        what = f"reaches {1e6 * y[j]:.3g} um, more than half of the air gap of {1e6 * gap[j]:g} um"
        todo = "expect strong nonlinearity; excite less"
        if y[j] > gap[j]:
            what, todo = (
                f"reaches {y[j]:.3g} m, the air gap is {gap[j]:g} m",
                "check air_gap, and that y is in metres",
            )
        found.append(Finding("warning", f"{record.name}: y.{record.axes[j]}", what, todo))
    return found if record.i_c is None else [*found, *_currents(record, record.i_c, bias)]


def _currents(record: Record, i_c: FloatArray, bias: FloatArray) -> list[Finding]:
    """Currents stay below the bias, or about it where the whole current was recorded; the worst axis is named."""
    mean = i_c.mean(axis=0)
    largest = np.abs(i_c - np.where(np.abs(mean / bias - 1.0) < HOLDS_BIAS, mean, 0.0)).max(axis=0)
    j = int(np.argmax(largest / bias))
    if largest[j] <= bias[j]:
        return []
    what = f"reaches {largest[j]:.3g} A, more than the bias current of {bias[j]:g} A: a magnet cannot push"
    todo = "excite less, or check bias_current"
    if mean[j] > 0.0 and np.abs(i_c[:, j] - mean[j]).max() <= bias[j]:
        apart = f"{100 * abs(mean[j] / bias[j] - 1.0):.2g} % {'above' if mean[j] > bias[j] else 'below'}"
        what = f"has a mean of {mean[j]:.4g} A, {apart} bias_current = {bias[j]:g} A, and reaches {largest[j]:.3g} A"
        todo = "if it is the whole current, correct bias_current; if the control current alone, a magnet cannot push: "
        todo += "excite less"
    return [Finding("warning", f"{record.name}: i_c.{record.axes[j]}", what, todo)]


def _periods(record: Record) -> list[Finding]:
    """Enough periods for the noise to be known well."""
    if record.periods >= 4:
        return []
    todo = "record 4 periods or more, or state the period"
    if record.period is None:
        what = "no period of the excitation found: the noise is what no smooth response to i_e explains, and drift "
        what += "is not looked for"
        return [Finding("warning", record.name, what, todo)]
    if record.periods < 2:
        what = f"{record.periods} period of the excitation: no misfit in units of the noise, and no diagnosis"
        return [Finding("warning", record.name, what, todo, stops_diagnosis=True)]
    what = f"{record.periods} periods: few lines beside the excited ones tell the noise; tones are looked for on "
    what += "excited lines, at the mains and at the speed alone"
    return [Finding("warning", record.name, what, todo)]


def _controller(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """i_c follows from i_e and y through the controller."""
    missed = controller_missed(loop, lines)
    signal, order, left = reordered(loop, lines)
    if missed > UNEXPLAINED and left < 0.5 * missed:
        what = f"i_c is missed by {100 * missed:.0f} % as the columns are named, by {100 * left:.0f} % with "
        return [
            Finding.fault(f"{record.name}: {signal}", what + renamed(record, order), f"put right the axes of {signal}")
        ]
    fit = fit_controller(loop, lines)
    moving = moves(np.asarray(lines.i_c))
    if np.median(fit.missed[moving]) > UNEXPLAINED:
        if opposite := _opposite(record, loop, lines, float(np.median(fit.missed[moving]))):
            return opposite
        if record.is_rebuilt:  # what drove the loop is known then
            what = f"i_c follows what drives the loop with {100 * np.median(fit.missed[moving]):.0f} % left unexplained"
            todo = "check the lag of the amplifier; a diagnosis ranks what else it may be"
            return [Finding("warning", f"{record.name}: i_c", what, todo)]
        return _excitation(record, loop, lines)
    slips = [_slip(scale, error) for scale, error in zip(fit.scale, fit.std_error, strict=True)]
    found = []
    for slip in dict.fromkeys(slip for slip in slips if slip is not None):
        axes = ", ".join(axis for axis, own in zip(record.axes, slips, strict=True) if own == slip)
        found.append(_slipped(f"{record.name}: {slip[0]} on {axes}", *slip, "the controller's equation"))
    if not found:
        found += slips_of_instants(record, loop, lines)
    if record.has_known_command:  # whatever the gains miss, i_e holds
        return found
    judged = moving & [slip is None for slip in slips]
    # a factor on all of i_c is R of a voltage-driven coil, which is fitted
    first = 0 if lines.i_e.any() else 1
    known = np.ones_like(fit.scale)
    if loop.rig.amplifier.resistance is not None:
        known = np.hstack([known[:, :first], np.repeat(fit.scale[:, first : first + 1], fit.scale.shape[1] - first, 1)])
    return found + _gains(record, fit, fit.scale / known, judged)


def _opposite(record: Record, loop: NominalLoop, lines: Lines, missed: float) -> list[Finding]:
    """y, r or both whose sign, turned, lets a controller that acts on them explain i_c; nothing where none does."""
    if not lines.r.any():
        return []
    turned = {"y": replace(lines, y=-lines.y), "r": replace(lines, r=-lines.r)}
    turned["y and r"] = replace(lines, y=-lines.y, r=-lines.r)
    left = {signal: float(np.median(fit_controller(loop, own).missed)) for signal, own in turned.items()}
    signal = min(left, key=lambda name: left[name])
    if left[signal] > min(0.5 * missed, UNEXPLAINED):
        return []
    what = f"i_c is missed by {100 * missed:.0f} % as it is, and by {100 * left[signal]:.0f} % with {signal} turned"
    return [Finding.fault(f"{record.name}: {signal}", what, f"the sign of {signal} is opposite: {TURNED}")]


def _slip(scale: FloatArray, error: FloatArray) -> tuple[str, float] | None:
    """The signal of one axis that is too large by a factor of `SLIPS`, and this factor."""
    is_known = error < 0.1 * np.abs(scale)
    excitation, gains = scale[:1], scale[1:][is_known[1:]]
    if not (is_known[0] and len(gains)):
        return None

    def near(values: FloatArray, factor: float) -> bool:
        return bool(np.all(np.abs(values / factor - 1.0) < 0.3))

    for factor in SLIPS:
        if near(scale[:1], factor) and near(gains, factor):
            return "i_c", factor
        if near(excitation, 1.0 / factor) and near(gains, 1.0):
            return "i_e", factor
        if near(gains, 1.0 / factor) and near(excitation, 1.0):
            return "y", factor
    return None


def _slipped(where: str, signal: str, factor: float, by: str) -> Finding:
    if factor < 0.0:
        todo = "map it with a factor -1" + (
            ", and r with it, or turn the controller in the rig" if signal == "y" else ""
        )
        return Finding.fault(where, f"the sign is opposite to what {by} calls for", todo)
    size = f"{factor:g} times too large" if factor > 1.0 else f"{1.0 / factor:g} times too small"
    unit = UNITS.get((signal, factor))
    return Finding.fault(
        where, f"{size} for {by}" + (f": it looks like {unit}" if unit else ""), "give SI units, A and m"
    )


def _gains(record: Record, fit: ControllerFit, scale: FloatArray, judged: NDArray[np.bool_]) -> list[Finding]:
    """The gains by which i_c follows, `scale` times those of the rig, are those of the rig."""
    off = np.abs(scale - 1.0)
    least = np.maximum(LEAST_SHARE, fit.missed)[:, None]  # below what the whole equation misses no gain is determined
    matters = judged[:, None] & (off * fit.share > least)
    excess = np.where(matters, off - 5.0 * fit.std_error, 0.0)
    told = excess > DOUBTFUL_GAIN
    doubtful = np.flatnonzero(told.any(axis=0))
    if not len(doubtful):
        return []
    factors = [f"{fit.parts[k]} x {_factor(record.axes, scale[:, k], judged, told[:, k])}" for k in doubtful]
    what = f"the recorded i_c follows from i_e and y with {', '.join(factors)} of what rig and record say"
    is_command = np.abs(scale[judged, 0]).max() < WITHOUT_EXCITATION
    causes = {
        EXCITATION_SLIP: (ADD_EXCITATION if is_command else "check the scale of i_e", doubtful == 0),
        CONTROLLER_SLIP: ("correct [controller], or take the rig file of that day", doubtful > 0),
    }
    todos = {slip: todo for slip, (todo, own) in causes.items() if own.any()}
    parts = [*_own_scale(record.axes, told, judged), *todos.values()]
    todo = f"{'; '.join(parts)}; or physics is missing: a diagnosis ranks {' and '.join(todos)} beside it"
    wrong = excess > WRONG_GAIN
    is_sought = (scale > 1.0 + LEAST) & (scale < 1.0 + MOST)
    severity: Severity = "fault" if wrong.any() else "warning"
    stops = bool(np.any(wrong & ~is_sought))
    return [Finding(severity, f"{record.name}: controller", what, todo, stops_diagnosis=stops)]


def _factor(axes: Sequence[str], scale: FloatArray, judged: NDArray[np.bool_], told: NDArray[np.bool_]) -> str:
    """One factor for all axes, or those of the axes where it is off, or their range where these are many."""
    own = scale[judged]
    if np.ptp(own) <= DOUBTFUL_GAIN:
        return f"{np.median(own):.3g}"
    if np.count_nonzero(told) > MOST_NAMED:
        return f"{np.median(own):.3g} ({own.min():.3g} to {own.max():.3g} over the axes)"
    return " and ".join(f"{scale[j]:.3g} on {axis}" for j, axis in enumerate(axes) if told[j])


def _own_scale(axes: Sequence[str], told: NDArray[np.bool_], judged: NDArray[np.bool_]) -> list[str]:
    """Where some axes alone are off: the channel whose scale would do that, as one controller has the same gains."""
    off = [axis for axis, own in zip(axes, told, strict=True) if own.any()]
    if len(off) == np.count_nonzero(judged):
        return []
    of_i_e, of_y = told[:, 0].any(), told[:, 1:].any()
    channel = "i_c" if of_i_e and of_y else "i_e" if of_i_e else "y"
    return [f"check the scale of {channel} on {', '.join(off)}"]


def _closed_loop(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """Without i_c: y follows i_e as in the nominal closed loop."""
    expected = expected_displacement(loop, lines)
    alike, by = correlation(lines.y, expected), "the nominal loop under i_e"
    if alike < -ALIKE:
        return [_slipped(f"{record.name}: y", "y", -1.0, by)]
    if alike < ALIKE:
        return _excitation(record, loop, lines)
    gain = float(np.median(gain_of(lines.y, expected)))
    factor = next((f for f in SLIPS if 0.4 < gain / f < 2.5), None)
    return [] if factor is None else [_slipped(f"{record.name}: y", "y", factor, by)]


def _excitation(record: Record, loop: NominalLoop, lines: Lines) -> list[Finding]:
    """The recorded i_e is the one that drove the loop."""
    wanted, given = called_for(loop, lines)
    alike, where = correlation(wanted, given), f"{record.name}: i_e"
    what = f"what drove the loop correlates with i_e by {alike:.2f} only"
    partly = Finding("warning", where, what, "raise the excitation above the noise, and see that i_e and i_c are true")
    if alike > ALIKE:
        return [partly]
    as_named = f"what drove the loop correlates with i_e by {alike:.2f} as it is"
    order = best_order(wanted, given)
    if (ordered := correlation(wanted, given[:, order])) > ALIKE:
        what = f"{as_named}, by {ordered:.2f} with {renamed(record, order)}"
        return [Finding.fault(where, what, "put right the axes of i_e, or of y")]
    shift, height = best_shift(wanted, given, lines)
    if height > ALIKE:
        late = f"{abs(shift)} samples ({abs(1e3 * shift / record.sample_rate):.4g} ms)"
        what = f"{as_named}, by {height:.2f} when it is moved by {late} to {'later' if shift > 0 else 'earlier'} times"
        return [
            Finding.fault(where, what, "line up i_e with y; it may be that of another record with the same sequence")
        ]
    if alike > 5.0 * chance(wanted, given):
        return [partly]
    return [Finding.fault(where, f"{as_named}: it seems to belong to another record", "give the i_e of this record")]
