"""Does a record pass through operating points: does a set-point, speed or load move it while it is recorded?

Of a record with periods a slow ramp is seen by the means of its periods, whatever the model: in the last half of them,
where a start from elsewhere has died away, they must go on at the same rate.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.findings import Finding, Kind, Where
from ambid.model import Model
from ambid.record import Record

OPERATING_POINT_DRIFT = Kind(
    "operating_point_drift",
    "warning",
    "the means drift[: {displacements} from {displacement_begin_m:.5g|um} to {displacement_end_m:.5g|um}][ over a "
    "range of {displacement_range_m:.5g|um}][; {currents} from {current_begin_a:.4g} A to "
    "{current_end_a:.4g} A]; the record passes through operating points, which is no drift of the machine, but "
    "hides missing physics",
    "cut it where it is steady (Record.rows), and give each part the rig of its operating point",
)

PARTS = 8
"""Of a record, whose means of y are held against each other."""
MOVED = 2.0
"""Standard deviations of y within a part by which its mean may move; an excitation moves it by less."""
LEAST_PERIODS = 8
"""Of a record whose periods show a ramp: half of them make a line whose halves are compared."""
CERTAIN = 8.0
"""Standard errors of a ramp's slope."""
EVEN = 0.5
"""Part of a ramp's slope that each half of the line must have: what dies away has less in the second."""
NOTICED = 10.0
"""Rms of the noise over which a ramp must lead: on the tenth line it is then as loud as the noise."""


def path(record: Record, model: Model) -> list[Finding]:
    """The means of y and i_c stay where they are, or where a model moves them; else from where to where they go.

    A free response, which comes to rest, is none.
    """
    drift = {} if record.is_free_response else _ramps(record) or _moves(record, model)
    return [OPERATING_POINT_DRIFT(Where(record=record.name), **drift)] if drift else []


def _ramps(record: Record) -> dict[str, Any]:
    """Channels that go on slowly at one rate through the last half of the periods."""
    if record.period is None or record.periods < LEAST_PERIODS:
        return {}
    usual = record.y if record.i_c is None else np.hstack([record.y, record.i_c])
    periods = usual[: record.periods * record.period].reshape(record.periods, record.period, -1)
    means, late = periods.mean(axis=1), periods[record.periods // 2 :]
    change = np.diff(late, axis=0)
    noise = np.sqrt(np.mean((change - change.mean(axis=1, keepdims=True)) ** 2, axis=(0, 1)) / 2.0)
    line = late.mean(axis=1)
    (slope, error), middle = _slope(line), len(line) // 2
    first, second = _slope(line[:middle])[0], _slope(line[middle:])[0]
    is_even = np.minimum(first * slope, second * slope) > EVEN * slope**2
    leads = np.abs(slope) * record.periods > NOTICED * noise
    ramps = np.flatnonzero(is_even & leads & (np.abs(slope) > CERTAIN * error))
    axes = len(record.axes)
    groups = (ramps[ramps < axes], ramps[ramps >= axes])
    return _drift(record, groups, means[1], means[-1]) if len(ramps) else {}


def _moves(record: Record, model: Model) -> dict[str, Any]:
    """The axis whose mean of y moves most from part to part, by more than an excitation moves it."""
    if record.samples < PARTS**2:  # noise alone moves means of fewer samples
        return {}
    means, within = _of_parts(record.y)
    far = np.ptp(means, axis=0)
    if (far >= MOVED * within).any() and not record.is_rebuilt and model.is_stable:
        # a slow excitation moves the means, too: as far as the model does, whatever it is worth, nothing else does
        far = np.minimum(far, np.ptp(means - _of_parts(model.response(record)[:, : len(record.axes)])[0], axis=0))
    j = int(np.argmax(far / within))
    if far[j] < MOVED * within[j]:
        return {}
    goes = abs(means[-1, j] - means[0, j])
    beyond = None if far[j] < 1.1 * goes else float(far[j])  # it comes back
    own = np.array([j])
    return _drift(record, (own, own[:0]), means[0], means[-1]) | {"displacement_range_m": beyond}


def _of_parts(y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of the parts, and the mean standard deviation within one."""
    parts = np.array_split(y, PARTS)
    return np.array([part.mean(axis=0) for part in parts]), np.mean([part.std(axis=0) for part in parts], axis=0)


def _drift(
    record: Record, groups: tuple[NDArray[np.intp], NDArray[np.intp]], begin: FloatArray, end: FloatArray
) -> dict[str, Any]:
    """Values of the finding: channels of y and of i_c by their columns, and where each begins and ends."""
    found: dict[str, Any] = {"displacement_range_m": None}
    for (channels, name), own in zip((("displacements", "displacement"), ("currents", "current")), groups, strict=True):
        unit = "m" if name == "displacement" else "a"
        found |= {
            channels: [record.channels[k] for k in own] or None,
            f"{name}_begin_{unit}": begin[own].tolist() or None,
            f"{name}_end_{unit}": end[own].tolist() or None,
        }
    return found


def _slope(means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope of each column by its row, and its standard error."""
    at = np.arange(len(means)) - 0.5 * (len(means) - 1)
    slope = at @ means / (at @ at)
    left = means - means.mean(axis=0) - at[:, None] * slope
    error = np.sqrt(np.sum(left**2, axis=0) / max(len(means) - 2, 1) / (at @ at))
    return slope, error
