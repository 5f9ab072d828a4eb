"""Does i_c follow from i_e and y through the rig's controller; if not, by which column, sign, unit or gain?"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.checking.controller import SURELY, ControllerFit, fit_channels, fit_controller, is_off
from ambid.checking.equations import controller_missed, reordered
from ambid.checking.excitation_slips import slips_of_excitation
from ambid.checking.instants import slips_of_instants
from ambid.checking.lines import Lines, moves
from ambid.checking.machine import taken_as
from ambid.checking.nominal import NominalLoop
from ambid.checking.signs import SLIPS, UNEXPLAINED, opposite_sign, turned, wrong_unit
from ambid.effects.channels import ExcitationGainError
from ambid.effects.slips import LEAST, MOST, ControllerGainError
from ambid.findings import Finding, Kind, Severity, Where
from ambid.record import Record
from ambid.rig.tolerance import TYPICAL

WRONG_GAIN = 0.10
"""Relative error of a controller's gain, beyond `SURELY`, that is no matter of degree."""
WITHOUT_EXCITATION = 0.1
"""Factor of i_e in i_c up to which i_c was recorded before i_e joins it."""
LEAST_SHARE = 0.02
"""Part of i_c that an error of a gain has to be to matter; an integral acts below most lines."""

CHANNELS_EXCHANGED = Kind(
    "channels_exchanged",
    "error",
    "the controller's equation misses {missed:.0f|%} of i_c as the columns are named, and {missed_exchanged:.0f|%} "
    "with {columns} of {signal} taken as {axes}",
    "correct the axes of {signal}",
)
CURRENT_UNEXPLAINED = Kind(
    "current_unexplained",
    "warning",
    "{missed:.0f|%} of i_c does not follow from what drives the loop",
    "check the lag of the amplifier; a diagnosis ranks what else it may be",
)
_FACTORS = "i_c follows from i_e and y with factors other than 1 on what rig and record say: {factors:.3g}"
_CHECK = "[check the scale of {channel} on {axes}; ][correct {table} in the rig, or take the rig file of that day; ]"
_RANKED = "or physics is missing: a diagnosis ranks {ranked} beside it"
GAINS_DIFFER = Kind("gains_differ", "error", _FACTORS, _CHECK + _RANKED)
"""A matter of degree: a diagnosis ranks it beside the physics."""
GAINS_BEYOND_RANGE = Kind("gains_beyond_range", "error", _FACTORS, _CHECK + _RANKED)
"""By more than a diagnosis looks for."""
CURRENT_WITHOUT_EXCITATION = Kind(
    "current_without_excitation",
    "error",
    _FACTORS,
    "it seems that i_c was recorded before i_e is added: record the current of the coil, or add i_e to i_c; [correct "
    "{table} in the rig, or take the rig file of that day; ]" + _RANKED,
)


def slips_of_controller(
    record: Record, loop: NominalLoop, lines: Lines, responses: Lines | None = None
) -> list[Finding]:
    """i_c follows from i_e and y through the controller; of a record without periods `responses` give the gains."""
    missed = controller_missed(loop, lines)
    signal, order, left = reordered(loop, lines)
    if missed > UNEXPLAINED and left < 0.5 * missed:
        values: dict[str, Any] = {
            "missed": missed,
            "missed_exchanged": left,
            "signal": signal,
            **taken_as(record, order),
        }
        return [CHANNELS_EXCHANGED(Where(record=record.name, channel=signal), **values)]
    fit = fit_controller(loop, lines)
    moving = moves(np.asarray(lines.i_c)) & np.isfinite(fit.missed)
    unexplained = float(np.median(fit.missed[moving])) if moving.any() else 0.0
    if unexplained > UNEXPLAINED:
        if opposite := turned(record, loop, lines, unexplained):
            return opposite
        if record.is_rebuilt:  # what drove the loop is known then
            return [CURRENT_UNEXPLAINED(Where(record=record.name, channel="i_c"), missed=unexplained)]
        return slips_of_excitation(record, loop, lines)
    slips = [_slip(scale, error) for scale, error in zip(fit.scale, fit.std_error, strict=True)]
    found = []
    for slip in dict.fromkeys(slip for slip in slips if slip is not None):
        axes = [axis for axis, own in zip(record.axes, slips, strict=True) if own == slip]
        found.append(_slipped(record, *slip, axes))
    if not found:
        found += slips_of_instants(record, loop, lines)
    if record.has_known_command:  # whatever the gains miss, i_e holds
        return found
    if not lines.whole_periods:
        if responses is None:
            return found
        lines, fit = responses, fit_controller(loop, responses)
    judged = moving & [slip is None for slip in slips]
    least = np.maximum(LEAST_SHARE, fit.missed)[:, None]  # below what the whole equation misses no gain is determined
    # a small part of i_c shows no more than the factor that all gains have in common
    return found + (
        _gains(loop, record, fit, _factor(loop, lines, fit), judged, least)
        or _gains(loop, record, own := fit_channels(loop, lines), _factor(loop, lines, own), judged)
    )


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


def _slipped(record: Record, signal: str, factor: float, axes: Sequence[str]) -> Finding:
    if factor < 0.0:
        return opposite_sign(record, signal, axes=axes)
    return wrong_unit(record, signal, axes, factor, "controller's equation")


def _factor(loop: NominalLoop, lines: Lines, fit: ControllerFit) -> FloatArray:
    """Of each part, (axes, parts); what is on all of i_c is R of a voltage-driven coil, which is fitted."""
    if loop.rig.amplifier.resistance is None:
        return fit.scale
    first = 0 if lines.i_e.any() else 1
    return np.hstack([fit.scale[:, :first], fit.scale[:, first:] / fit.scale[:, first : first + 1]])


def _gains(
    loop: NominalLoop,
    record: Record,
    fit: ControllerFit,
    scale: FloatArray,
    judged: NDArray[np.bool_],
    least: FloatArray | float = 0.0,
) -> list[Finding]:
    """The gains by which i_c follows, `scale` times the rig's, are those to a part `least` of i_c."""
    known = loop.rig.known_to("sensor_gain") or TYPICAL["sensor_gain"]
    off = np.abs(scale - 1.0)
    significant = judged[:, None] & (off * fit.share > least) & is_off(off, fit.std_error, known)
    doubtful = np.flatnonzero(significant.any(axis=0))
    if not len(doubtful):
        return []
    wrong = significant & (off - SURELY * fit.std_error > WRONG_GAIN)
    is_sought = (scale > 1.0 + LEAST) & (scale < 1.0 + MOST)
    is_command = significant[:, 0].any() and np.abs(scale[judged, 0]).max() < WITHOUT_EXCITATION
    kind = GAINS_DIFFER
    if np.any(wrong & ~is_sought):
        kind = CURRENT_WITHOUT_EXCITATION if is_command else GAINS_BEYOND_RANGE
    severity: Severity = "error" if wrong.any() else "warning"
    causes = {ExcitationGainError.name: bool((doubtful == 0).any()), ControllerGainError.name: bool(doubtful.any())}
    values: dict[str, Any] = {
        "factors": {
            fit.parts[k]: _factors(record.axes, scale[:, k], fit.std_error[:, k], known, judged, significant[:, k])
            for k in doubtful
        },
        "channel": _channel(significant, judged),
        "axes": [axis for axis, own in zip(record.axes, significant, strict=True) if own.any()],
        "table": "controller" if doubtful.any() else None,
        "ranked": [name for name, is_one in causes.items() if is_one],
    }
    return [kind(Where(record=record.name, key="controller"), severity=severity, **values)]


def _factors(
    axes: Sequence[str],
    scale: FloatArray,
    error: FloatArray,
    known: float,
    judged: NDArray[np.bool_],
    significant: NDArray[np.bool_],
) -> Any:
    """One factor for all axes where they agree, or those of the axes where it is off, or their range if many are."""
    own, spread = scale[judged], np.maximum(error[judged], 1e-9)
    common = float(np.average(own, weights=spread**-2))
    if not is_off(own - common, spread, known).any():
        return common
    if np.count_nonzero(significant) > 4:
        return {"median": float(np.median(own)), "lowest": float(own.min()), "highest": float(own.max())}
    return {axis: float(scale[j]) for j, axis in enumerate(axes) if significant[j]}


def _channel(significant: NDArray[np.bool_], judged: NDArray[np.bool_]) -> str | None:
    """The channel whose scale would do that: that of i_e, or where some axes alone are off, of any.

    One controller has the same gains on all axes.
    """
    of_i_e, of_y = significant[:, 0].any(), significant[:, 1:].any()
    if np.count_nonzero(significant.any(axis=1)) == np.count_nonzero(judged):
        return "i_e" if of_i_e else None
    return "i_c" if of_i_e and of_y else "i_e" if of_i_e else "y"
