"""Gates that every record passes: each refuses with what was found and what to do, or returns findings."""

from collections.abc import Collection, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ambid.channels import SIGNALS
from ambid.errors import InputError, RecordError, WrongUnit
from ambid.findings import Finding, Kind, Where
from ambid.rig import Rig
from ambid.rig.fields import LARGEST_VALUE

AXES_REORDERED = Kind("axes_reordered", "note", "axes {found} were reordered to the rig's {wanted}")
LARGE_CURRENT = Kind("large_current", "warning", "rms of {rms_a:.4g} A, above {limit_a:g} A: taken as it is")
BEYOND_AIR_GAP = Kind(
    "beyond_air_gap",
    "warning",
    "reaches {largest_m:.4g} m, the air gap is {air_gap_m:g} m: taken as it is",
    "see that air_gap and the unit of {signal} are right",
)
MEAN_LEFT_OUT = Kind(
    "mean_left_out",
    "note",
    "measured from elsewhere than the middle of the air gap (means of {axes}: {means_m:.4g} m at air gaps of "
    "{air_gaps_m:g} m): its mean is left out, and that of r",
)
SAMPLE_RATE_OF_RIG = Kind(
    "sample_rate_of_rig", "note", "sample rate {rate_hz:.9g} Hz, taken as the rig's {rig_rate_hz:g} Hz"
)
TIME_JITTER = Kind("time_jitter", "warning", "t jitters by up to {share:.0f|%} of a sample; taken as uniform")
TIME_OFFSET = Kind("time_offset", "note", "t starts at {start_s:.9g} s; counted from 0")
CURRENT_CLIPPED = Kind(
    "current_clipped",
    "warning",
    "clipped: {share:.1f|%} of the samples are at {level_a:.6g} A, a limit of the amplifier or of its sensor that a "
    "linear loop does not have",
)
FREE_RESPONSE = Kind(
    "free_response",
    "note",
    "{signals} constant on every axis: the record is used as a free response from the state in which it begins",
)
AXIS_NOT_EXCITED = Kind(
    "axis_not_excited",
    "warning",
    "{signals} constant: this axis is not excited, and the record says little of its parameters",
    "excite this axis as well",
)
COMMAND_CLIPPED = Kind(
    "command_clipped",
    "note",
    "clipped: {share:.1f|%} of the samples are at {level:.6g}; what was applied less what the "
    "law asks for is taken as excitation",
)

SMALLEST_CHANGE = 1e-20
"""Metres, or ampere, that a channel must change by: no sensor resolves less, and its square loses its digits."""
MIN_SAMPLES = 3
"""Fewest samples of a record or a period: fewer have no line of their spectrum between 0 and half the sample rate."""
LARGEST_CURRENT_RMS = 100.0
"""Ampere: larger than most machines', and reached at once by values in mA."""
BIASES_OF_CURRENT = 20.0
"""Where the bias currents are known, an rms of more than so many of them is needed, too, to look like mA."""
GAPS_OF_TRAVEL = 10.0
"""Air gaps beyond which |y| looks like mm; from one on it is reported."""
FROM_ELSEWHERE = 0.9
"""Air gaps from which on a mean is no displacement from their middle, but an absolute gap: no rotor stands so far."""
ALLOWED = ("travel", "current")
"""What a person may vouch for: displacements and currents that look like a wrong unit."""
LONGEST_STANDSTILL = 50
"""Samples at one value from which on a channel may have hung, if that is also `UNUSUAL` times as long as usual."""
UNUSUAL = 5.0
"""What a coarse converter reads of a slow signal stands still, too: but not here and there so much longer."""
DECAYED = 10.0
"""Standard deviations at its end that a free response stands out by before: of noise alone 1e6 samples reach 5."""


def order_of_axes(where: str, found: tuple[str, ...], wanted: tuple[str, ...], of: str) -> list[int]:
    """Columns of `found` in the order of `wanted`; the two must name the same axes."""
    if len(set(found)) < len(found):
        raise RecordError(f"{where}: an axis is named twice in {', '.join(found)}; keep one")
    if set(found) != set(wanted):
        missing = ", ".join(axis for axis in wanted if axis not in found) or "none"
        unknown = ", ".join(axis for axis in found if axis not in wanted) or "none"
        raise RecordError(
            f"{where}: axes {', '.join(found)}, but {of} has {', '.join(wanted)} "
            f"(missing: {missing}; unknown: {unknown}); rename or add the columns"
        )
    return [found.index(axis) for axis in wanted]


def require_every_y(where: str, signals: Mapping[str, tuple[str, ...]], rig_axes: tuple[str, ...] | None) -> None:
    """Refuse a record whose y lacks an axis that the rig, or another of its signals, has; other names are no lack.

    Parameters
    ----------
    where : str
    signals : mapping of str to tuple of str
        Axes of each signal, y among them.
    rig_axes : tuple of str or None
    """
    own, others = signals["y"], {name: axes for name, axes in signals.items() if name != "y"}
    theirs = others if rig_axes is None else {"the rig": rig_axes, **others}
    for name, axes in theirs.items():
        lacking = [axis for axis in axes if axis not in own]
        if lacking and set(own) < set(axes):
            raise RecordError(
                f"{where}: {', '.join(f'y.{axis}' for axis in lacking)} is missing: {name} has the axes "
                f"{', '.join(axes)}, y has {', '.join(own)}; add the column, or name it y.{lacking[0]}"
            )


def require_length(where: str, samples: int, period: int | None) -> None:
    """Refuse a record that is too short, or a stated period that does not fit in it."""
    if samples < MIN_SAMPLES:
        raise RecordError(f"{where}: {samples} samples, at least {MIN_SAMPLES} are needed; record for longer")
    if period is not None and not (isinstance(period, int | np.integer) and MIN_SAMPLES <= period <= samples):
        raise RecordError(
            f"{where}: period = {period!r}; give a whole number of samples from {MIN_SAMPLES} to {samples}"
        )


def require_finite(where: str, columns: Iterable[tuple[str, NDArray[np.float64]]]) -> None:
    """Refuse NaN, infinity and what is beyond `LARGEST_VALUE`; names the channel and the first row (counted from 1)."""
    for channel, values in columns:
        bad = np.flatnonzero(~(np.abs(values) <= LARGEST_VALUE))
        if bad.size:
            raise RecordError(
                f"{where}: {channel} is {values[bad[0]]} in row {bad[0] + 1} ({bad.size} such rows); "
                "cut the record there or record it again"
            )


def require_alive(where: str, channel: str, values: NDArray[np.float64]) -> None:
    """Refuse a channel that never changes."""
    if np.ptp(values) < SMALLEST_CHANGE:
        raise RecordError(
            f"{where}: {channel} is constant at {values[0]:.6g}: a dead or unplugged sensor; repair it and record again"
        )


def require_moving(where: str, channel: str, values: NDArray[np.float64]) -> None:
    """Refuse a channel that stands still for a while, as a sensor or card does that hangs."""
    ends = np.flatnonzero(np.diff(values))
    lengths = np.diff(np.concatenate([[-1], ends, [len(values) - 1]]))
    k = int(np.argmax(lengths))
    others = np.repeat(lengths, lengths)[np.repeat(lengths, lengths) < lengths[k]]
    usual = float(np.quantile(others, 0.99)) if len(others) else float(lengths[k])
    if lengths[k] >= LONGEST_STANDSTILL and lengths[k] > UNUSUAL * usual:
        first = int(lengths[:k].sum()) + 1
        raise RecordError(
            f"{where}: {channel} stands still at {values[first - 1]:.6g} in rows {first} to {first + lengths[k] - 1}: "
            "a sensor or card that hung; cut the record before or after, or record again"
        )


def require_known(allow: Collection[str]) -> None:
    """Refuse what nobody can vouch for."""
    unknown = [what for what in allow if what not in ALLOWED]
    if unknown:
        raise InputError(f"allow: {unknown[0]}: expected {' or '.join(ALLOWED)}")


def require_ampere(
    where: str,
    channel: str,
    values: NDArray[np.float64],
    rig: Rig | None = None,
    *,
    is_allowed: bool = False,
    otherwise: str = ", or vouch for it (allow: current)",
) -> list[Finding]:
    """Refuse currents that only make sense in mA, or note them where a person vouches for them.

    `otherwise` is what to do if they are right.
    """
    rms = float(np.sqrt(np.mean(values**2)))
    bias = 0.0 if rig is None else max(bearing.bias_current for bearing in rig.bearings)
    limit = max(LARGEST_CURRENT_RMS, BIASES_OF_CURRENT * bias)
    if rms <= limit:
        return []
    if is_allowed:
        return [LARGE_CURRENT(Where(channel=channel), rms_a=rms, limit_a=limit)]
    problem = f"{channel} has an rms of {rms:.4g} A, allowed is {limit:g} A"
    raise WrongUnit(where, problem, f"it looks like mA; give ampere{otherwise}")


def require_size(where: str, channel: str, values: NDArray[np.float64]) -> None:
    """Refuse what no machine of ours has, and another unit explains."""
    own = SIGNALS[channel.partition(".")[0]]
    largest = float(np.abs(values).max())
    if largest > own.most:
        problem = f"{channel} reaches {largest:.4g} {own.unit}, allowed is {own.most:g} {own.unit}"
        raise WrongUnit(where, problem, f"it looks like {own.slip}; give {own.unit}")


def require_known_outputs(where: str, channels: Iterable[str], rig: Rig) -> None:
    """Refuse channels of which the rig file does not say what they measure."""
    for channel in channels:
        if lacking := rig.lacks(channel):
            raise RecordError(f"{where}: {channel} is not known of {rig.path or rig.name}: {lacking}")


def require_metres(
    where: str, signal: str, axes: tuple[str, ...], y: NDArray[np.float64], rig: Rig, *, is_allowed: bool = False
) -> list[Finding]:
    """Refuse displacements, or references, far beyond the air gap, or note them where a person vouches for them.

    The mean of an absolute gap does not count.
    """
    gaps = {axis: bearing.air_gap for bearing in rig.bearings for axis in bearing.axis_names}
    findings = []
    for axis, values in zip(axes, y.T, strict=True):
        largest = float(np.abs(displacement(values, gaps[axis])).max())
        if largest > GAPS_OF_TRAVEL * gaps[axis] and not is_allowed:
            problem = f"{signal}.{axis} reaches {largest:.4g} m, the air gap is {gaps[axis]:g} m"
            raise WrongUnit(
                where, problem, "it looks like micrometres or millimetres; give metres, or vouch for it (allow: travel)"
            )
        if largest > gaps[axis]:
            at = Where(channel=f"{signal}.{axis}")
            findings.append(BEYOND_AIR_GAP(at, signal=signal, largest_m=largest, air_gap_m=gaps[axis]))
    return findings


def displacement(y: NDArray[np.float64], gap: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """The same from the middle of the air gap, or, where it is read from elsewhere, about its mean."""
    mean = y.mean(axis=0)
    return np.asarray(y - np.where(np.abs(mean) > FROM_ELSEWHERE * gap, mean, 0.0))


def findings_of_means(axes: tuple[str, ...], y: NDArray[np.float64], rig: Rig) -> list[Finding]:
    """Find the axes whose y is read from elsewhere than the middle of the air gap."""
    gaps = np.array([bearing.air_gap for bearing in rig.bearings for _ in bearing.axis_names])
    mean = y.mean(axis=0)
    off = np.flatnonzero(np.abs(mean) > FROM_ELSEWHERE * gaps)
    if not len(off):
        return []
    own = [axes[k] for k in off]
    return [MEAN_LEFT_OUT(Where(channel="y"), axes=own, means_m=mean[off].tolist(), air_gaps_m=gaps[off].tolist())]


def require_on_shaft(where: str, z: NDArray[np.float64], rig: Rig) -> None:
    """Refuse loads that act beside the shaft; a plain mass has no length to be held against."""
    if rig.rotor.span is None:
        return
    low, high = rig.rotor.span
    off = np.flatnonzero((z < low) | (z > high))
    if off.size:
        raise RecordError(
            f"{where}: z = {z[off[0]]:g} m in row {off[0] + 1} is off the shaft, "
            f"which reaches from {low:g} to {high:g} m; give metres in the rig's z"
        )


def sample_rate_of(
    where: str, t: NDArray[np.float64] | None, stated: float | None, rig: Rig | None
) -> tuple[float, list[Finding]]:
    """Sample rate [Hz] from the times, what the file states and what the rig expects, which must agree."""
    findings: list[Finding] = []
    if stated is not None and not (np.isfinite(stated) and stated > 0):
        raise RecordError(f"{where}: fs = {stated} Hz; give a finite rate above zero")
    rate = stated
    if t is not None:
        measured = _rate_of_times(where, t, findings)
        if rate is None:
            # The last digit of written times is no reason for 9999.9997 Hz.
            rate = float(round(measured)) if abs(measured - round(measured)) < 1e-6 * measured else measured
        _require_same_rate(where, "t", measured, "fs", rate)
    if rate is None:
        raise RecordError(f"{where}: no sample rate; give fs [Hz] or t [s]")
    if rig is not None:
        expected = rig.sample_rate
        theirs = "the rig's sample_rate" if rig.path is None else f"sample_rate in {rig.path}"
        _require_same_rate(where, "t" if stated is None else "fs", rate, theirs, expected)
        if abs(rate - expected) > 1e-6 * expected:
            findings.append(SAMPLE_RATE_OF_RIG(rate_hz=rate, rig_rate_hz=expected))
        rate = expected
    return rate, findings


def _rate_of_times(where: str, t: NDArray[np.float64], findings: list[Finding]) -> float:
    steps = np.diff(t)
    back = np.flatnonzero(steps <= 0)
    if back.size:
        k = back[0] + 1
        raise RecordError(
            f"{where}: t does not increase in row {k + 1} ({t[k - 1]:.9g} s, then {t[k]:.9g} s); "
            "sort the rows, or write t with more digits"
        )
    dt = float(np.median(steps))
    gaps = np.flatnonzero(steps > 1.5 * dt)
    if gaps.size:
        k = gaps[0] + 1
        raise RecordError(
            f"{where}: gap in t before row {k + 1}: {steps[k - 1]:.6g} s where {dt:.6g} s is usual, "
            f"{round(steps[k - 1] / dt) - 1} samples are lost ({gaps.size} such gaps); cut the record there"
        )
    jitter = float(np.abs(steps / dt - 1).max())
    if jitter > 0.05:
        findings.append(TIME_JITTER(share=jitter))
    if t[0] != 0:
        findings.append(TIME_OFFSET(start_s=float(t[0])))
    return (len(t) - 1) / float(t[-1] - t[0])


def _require_same_rate(where: str, source: str, rate: float, other: str, expected: float) -> None:
    if abs(rate - expected) <= 1e-3 * expected:  # relative difference between sample rates that are called the same
        return
    units = ((1e-3, "milliseconds"), (1e-6, "microseconds"), (1 / expected, "sample numbers"))
    guess = [(factor, unit) for factor, unit in units if abs(rate / expected / factor - 1) < 0.01]
    hint = "; correct the one that is wrong"
    if guess and source == "t":
        looks = " or ".join(unit for _, unit in guess)
        hint = f": t looks like {looks}; give seconds, as t=COLUMN:{guess[0][0]:g} of a map does"
    raise RecordError(
        f"{where}: {source} says {rate:.6g} Hz, {other} says {expected:.6g} Hz (allowed difference 0.1 %){hint}"
    )


def findings_of_clipping(where: str, columns: Mapping[str, NDArray[np.float64]]) -> list[Finding]:
    """Refuse a clipped output of the loop; find a clipped current.

    Beyond its range a sensor says nothing, and no model can be held against what it reads. A current that stands at a
    limit is what the amplifier really did: the linear model misses it, but the reading is true.
    """
    findings = []
    for channel, values in columns.items():
        signal = SIGNALS[channel.partition(".")[0]]
        if signal.path not in ("heard", "recorder"):
            continue
        share, level = _clipped(values)
        if share and signal.name == "i_c":
            findings.append(CURRENT_CLIPPED(Where(channel=channel), share=share, level_a=level))
        elif share and signal.name != "u":
            raise RecordError(
                f"{where}: {channel} is clipped: {100 * share:.1f} % of the samples stand at {level:.6g} "
                f"{signal.unit}; lower the excitation or widen the range of the sensor"
            )
    return findings


def at_limits(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Samples in which a command stands at its highest or lowest value, where it is clipped, if it is at all."""
    return (values == values.max()) | (values == values.min())


def _clipped(values: NDArray[np.float64]) -> tuple[float, float]:
    """Share of the samples at a clipped extreme and its value; share 0 where nothing is clipped."""
    for level, inward in ((values.max(), np.max), (values.min(), np.min)):
        at = values == level
        share = float(at.mean())
        in_runs = bool(np.any(at[:-2] & at[1:-1] & at[2:]))
        # A coarse converter also repeats its extreme values, but hardly more often than the level next to them:
        # at most 2.4 times for a sine, and in a short record by three standard deviations of the counts more.
        count, next_to_it = int(at.sum()), 3 * int(np.sum(values == inward(values[~at])))
        if share > 0.01 and in_runs and count - next_to_it > 3.0 * np.sqrt(count + 3 * next_to_it):
            return share, float(level)
    return 0.0, 0.0


def decays(y: NDArray[np.float64]) -> bool:
    """Whether y of an axis moves by far more in the first half of a record than it does in the last quarter."""
    half, quarter = len(y) // 2, len(y) // 4
    rest = y[-quarter:]
    return bool(np.any(np.abs(y[:half] - rest.mean(axis=0)).max(axis=0) > DECAYED * rest.std(axis=0)))


def findings_of_excitation(
    where: str,
    axes: tuple[str, ...],
    y: NDArray[np.float64],
    i_e: NDArray[np.float64],
    r: NDArray[np.float64] | None = None,
) -> list[Finding]:
    """Refuse a record that nothing drives and that does not decay; find each axis that neither i_e nor r moves."""
    moving = np.ptp(i_e, axis=0) >= SMALLEST_CHANGE
    if r is not None:
        moving |= np.ptp(r, axis=0) >= SMALLEST_CHANGE
    still = [axis for axis, moves in zip(axes, moving, strict=True) if not moves]
    signals = ["i_e"] if r is None else ["i_e", "r"]
    if len(still) == len(axes) and decays(y):
        return [FREE_RESPONSE(signals=signals)]
    if len(still) == len(axes):
        what = "i_e is" if r is None else "i_e and r are"
        values = f"{', '.join(f'{value:.4g}' for value in i_e[0])} A"
        if r is not None:
            values = f"i_e {values}; r {', '.join(f'{value:.4g}' for value in r[0])} m"
        raise RecordError(
            f"{where}: no excitation: {what} constant ({values}) on every axis; "
            "excite the loop, begin the record where it has not come to rest, or check that what drives it was logged"
        )
    return [AXIS_NOT_EXCITED(Where(axis=axis), signals=signals) for axis in still]


def findings_of_limits(axes: tuple[str, ...], i_ref: NDArray[np.float64]) -> list[Finding]:
    """Find each command that stands at a limit: what was applied there is known, whatever the law asked for."""
    found = [(axis, *_clipped(values)) for axis, values in zip(axes, i_ref.T, strict=True)]
    return [
        COMMAND_CLIPPED(Where(channel=f"i_ref.{axis}"), level=level, share=share)
        for axis, share, level in found
        if share
    ]
