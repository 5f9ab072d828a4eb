"""What a record is made of, as its file has it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.channels import FURTHER, SIGNALS
from ambid.errors import RecordError
from ambid.findings import Kind
from ambid.record import checks
from ambid.record.channel_map import ChannelMap, as_map
from ambid.record.raw import RawRecord, raw_record
from ambid.record.readers import opened
from ambid.rig import Rig

AXES_OF_RIG = Kind("axes_of_rig", "note", "the file names no axes: its columns are taken as {axes}, the rig's order")


def arguments_from(
    path: Path,
    rig: Rig | None,
    mapping: ChannelMap | Mapping[str, str] | None,
    *,
    sample_rate: float | None,
    period: int | None,
) -> dict[str, Any]:
    """Arguments of `Record.from_arrays`; parameters and errors are those of `Record.load`."""
    where = str(path)
    columns = as_map(mapping)
    with opened(path) as content:
        raw = (raw_record if columns is None else columns.raw_record)(path, content, sample_rate)
    findings = list(raw.findings)
    if rig is not None:
        _take_sensors_out(raw, rig)
    named = {signal: found for signal, (found, _) in raw.signals.items() if signal not in FURTHER}
    if not named:
        raise RecordError(f"{where}: no signal of the axes; add columns such as i_e.<axis> and i_c.<axis>")
    first = "y" if "y" in named else next(iter(named))
    axes = named[first]
    if axes is None:
        if rig is None:
            raise RecordError(f"{where}: the file names no axes; add 'axes', or give the rig")
        axes = tuple(rig.axes)
        findings.append(AXES_OF_RIG(axes=axes))
    arrays: dict[str, Any] = {}
    if "y" in named:
        own = {signal: found or axes for signal, found in named.items()}
        checks.require_every_y(where, own, None if rig is None else tuple(rig.axes))
    for signal, (found, array) in list(raw.signals.items()):
        if signal in FURTHER:
            names = (found or axes) if "axis" in SIGNALS[signal].at else ()
            raw.further |= _by_channel(where, signal, array, names, rig)
            continue
        order = checks.order_of_axes(f"{where}: {signal}", found or axes, axes, first)
        arrays[signal] = array[:, order] if array.shape[1] == len(order) else array
    if raw.t is not None:
        if len(raw.t) != len(arrays[first]):
            raise RecordError(
                f"{where}: t has {len(raw.t)} rows, {first} has {len(arrays[first])}; give one t per sample"
            )
        checks.require_finite(where, [("t", raw.t)])
    checks.require_length(where, len(arrays[first]), period)
    rate, more = checks.sample_rate_of(where, raw.t, raw.sample_rate, rig)
    return {
        **arrays,
        "further": raw.further,
        "sample_rate": rate,
        "axes": axes,
        "name": path.stem.encode("utf-8", "surrogateescape").decode("utf-8", "replace"),  # where LANG=C
        "findings": (*findings, *more),
        "path": path,
        "provenance": content.provenance,
    }


def _take_sensors_out(raw: RawRecord, rig: Rig) -> None:
    """Make further channels of the displacements that are at a [[sensor]] of a rig."""
    found, array = raw.signals.get("y", (None, np.empty((0, 0))))
    apart = [sensor.name for sensor in rig.sensors if sensor.channel == f"y.{sensor.name}"]
    if found is None or not (at_sensors := [axis for axis in found if axis in apart]):
        return
    raw.further |= {f"y.{name}": array[:, found.index(name)] for name in at_sensors}
    kept = [k for k, axis in enumerate(found) if axis not in apart]
    del raw.signals["y"]
    if kept:
        raw.signals = {"y": (tuple(found[k] for k in kept), array[:, kept]), **raw.signals}


def _by_channel(
    where: str, signal: str, array: NDArray[np.float64], names: Sequence[str], rig: Rig | None
) -> dict[str, NDArray[np.float64]]:
    """Columns of a matrix by channel: of the axes, or of the sensors of a rig."""
    if not names and rig is not None:
        names = [sensor.name for sensor in rig.sensors if sensor.signal == signal]
    if array.shape[1] != len(names):
        listed = ", ".join(names) or "none"
        raise RecordError(
            f"{where}: {signal} has the shape {array.shape}, expected a column for each of {listed}; give N x columns"
        )
    return {f"{signal}.{name}": array[:, j] for j, name in enumerate(names)}
