"""Is a record of this rig at all, with displacements, currents and periods of a size that it can have?"""

from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.findings import Finding, Kind, Where
from ambid.record import Record
from ambid.record.checks import decays, displacement
from ambid.rig import Rig

AXES_DIFFER = Kind(
    "axes_differ", "error", "axes {axes}, the rig has {rig_axes}", "load the record with the rig that it belongs to"
)
RATE_DIFFERS = Kind(
    "sample_rate_differs",
    "error",
    "{sample_rate_hz:g} Hz, the rig samples at {rig_sample_rate_hz:g} Hz",
    AXES_DIFFER.remedy,
)
NOT_LOGGED = Kind(
    "excitation_not_logged", "error", "i_e was not logged", "load the record with its rig, whose controller rebuilds it"
)
NO_EXCITATION = Kind("no_excitation", "error", "no excitation: {signals} constant on every axis", "excite the loop")
HOLDS_BIAS = 0.1
"""Relative difference up to which a mean of i_c is the bias current itself: the whole current was recorded."""

TOO_SMALL = Kind(
    "displacement_too_small", "error", "rms {rms_m:.3g} m, below the resolution of any sensor", "give metres"
)
LARGE_TRAVEL = Kind(
    "large_travel",
    "warning",
    "reaches {peak_m:.3g|um}, more than half of the air gap of {air_gap_m:g|um}",
    "expect strong nonlinearity; excite less",
)
BEYOND_GAP = Kind(
    "travel_beyond_gap",
    "warning",
    "reaches {peak_m:.3g} m, the air gap is {air_gap_m:g} m",
    "check air_gap, and that y is in metres",
)
BEYOND_BIAS = Kind(
    "current_beyond_bias",
    "warning",
    "reaches {peak_a:.3g} A, more than the bias current of {bias_a:g} A: a magnet cannot push",
    "excite less, or check bias_current",
)
MEAN_BEYOND_BIAS = Kind(
    "mean_current_off_bias",
    "warning",
    "has a mean of {mean_a:.4g} A, {difference:+.2g|%} from bias_current = {bias_a:g} A, and reaches {peak_a:.3g} A",
    "if it is the whole current, correct bias_current; if the control current alone, a magnet cannot push: excite less",
)
NO_PERIOD = Kind(
    "period_not_found",
    "warning",
    "no period of the excitation found: the noise is what no smooth response to i_e explains; drift is not detected",
    "record 4 periods or more, or state the period",
)
ONE_PERIOD = Kind(
    "one_period",
    "warning",
    "{periods} period of the excitation: no misfit in units of the noise, and no diagnosis",
    NO_PERIOD.remedy,
)
FEW_PERIODS = Kind(
    "few_periods",
    "warning",
    "{periods} periods: few unexcited lines determine the noise; sinusoids are detected at excited lines, at the mains "
    "and at the speed alone",
    NO_PERIOD.remedy,
)


def slips_of_another_rig(record: Record, rig: Rig) -> list[Finding]:
    """Whether it has the rig's axes and rate, and an excitation: without these nothing else can be checked."""
    where = Where(record=record.name)
    if record.axes != rig.axes:
        return [AXES_DIFFER(where, axes=list(record.axes), rig_axes=list(rig.axes))]
    if abs(record.sample_rate / rig.sample_rate - 1.0) > 1e-6:
        return [RATE_DIFFERS(where, sample_rate_hz=record.sample_rate, rig_sample_rate_hz=rig.sample_rate)]
    if record.i_e is None:
        return [NOT_LOGGED(where)]
    if record.is_free_response and not decays(record.y):
        return [NO_EXCITATION(where, signals=["i_e"] if record.r is None else ["i_e", "r"])]
    return []


def slips_of_ranges(record: Record, rig: Rig) -> list[Finding]:
    """Displacements fit into the air gap, currents below the bias; the worst axis of each is named."""
    bearings = [bearing for bearing in rig.bearings for _ in bearing.axes]
    gap, bias = np.array([(bearing.air_gap, bearing.bias_current) for bearing in bearings]).T
    rms = record.y.std(axis=0)
    k = int(np.argmin(rms))
    if rms[k] < 1e-12:
        return [TOO_SMALL(Where(record=record.name, channel=f"y.{record.axes[k]}"), rms_m=float(rms[k]))]
    begun = record.y if record.r is None else record.y - record.r[0]  # a set-point is no travel
    y, found = np.abs(displacement(begun, gap)).max(axis=0), []
    j = int(np.argmax(y / gap))
    if y[j] > 0.5 * gap[j]:
        kind = BEYOND_GAP if y[j] > gap[j] else LARGE_TRAVEL
        where = Where(record=record.name, channel=f"y.{record.axes[j]}")
        found.append(kind(where, peak_m=float(y[j]), air_gap_m=float(gap[j])))
    return found if record.i_c is None else [*found, *_currents(record, record.i_c, bias)]


def _currents(record: Record, i_c: FloatArray, bias: FloatArray) -> list[Finding]:
    """Currents stay below the bias, or about it where the whole current was recorded; the worst axis is named."""
    mean = i_c.mean(axis=0)
    largest = np.abs(i_c - np.where(np.abs(mean / bias - 1.0) < HOLDS_BIAS, mean, 0.0)).max(axis=0)
    j = int(np.argmax(largest / bias))
    if largest[j] <= bias[j]:
        return []
    where = Where(record=record.name, channel=f"i_c.{record.axes[j]}")
    peak_a, bias_a, mean_a = (float(own[j]) for own in (largest, bias, mean))
    if mean[j] > 0.0 and np.abs(i_c[:, j] - mean[j]).max() <= bias[j]:
        difference = mean_a / bias_a - 1.0
        values: dict[str, Any] = {"mean_a": mean_a, "difference": difference}
        return [MEAN_BEYOND_BIAS(where, peak_a=peak_a, bias_a=bias_a, **values)]
    return [BEYOND_BIAS(where, peak_a=peak_a, bias_a=bias_a)]


def slips_of_periods(record: Record) -> list[Finding]:
    """Enough periods for the noise to be known well."""
    where = Where(record=record.name)
    if record.periods >= 4:
        return []
    if record.period is None:
        return [NO_PERIOD(where)]
    return [(ONE_PERIOD if record.periods < 2 else FEW_PERIODS)(where, periods=record.periods)]
