"""What a record is made of, as its file has it, and the gates that it passes when it is loaded, in their order."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.channels import FURTHER, SIGNALS, Channel
from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.record import checks
from ambid.record.channel_map import ChannelMap, as_map
from ambid.record.raw import RawRecord, Signals, raw_record
from ambid.record.readers import opened
from ambid.rig import Rig

AXES_OF_RIG = Kind("axes_of_rig", "note", "the file names no axes: its columns are taken as {axes}, the rig's order")
WITHOUT_I_C = Kind(
    "current_not_recorded",
    "note",
    "i_c was not recorded: K_i, K_s and tau_e are estimated from y alone; "
    "a lag of the amplifier, a delay of the loop and a lag of the sensor cannot be distinguished",
)
READ_WITHOUT_I_C = Kind(
    "read_current_not_recorded",
    "warning",
    "the controller reads i_c, which was not recorded: its noise goes round the loop and is taken for noise of y; "
    "where it is large, K_s may be further off than its interval says",
    "record the current that the controller reads",
)
WITHOUT_Y = Kind(
    "displacement_not_recorded",
    "note",
    "y was not recorded: the model is compared with {channels} alone, and the controller's law is not checked",
)
LOOP_NOISE_NOT_RECORDED = Kind(
    "loop_noise_not_recorded",
    "warning",
    "neither y nor i_c was recorded: noise of the sensors that the controller reads goes round the loop, and no "
    "channel shows it before the rotor does: where it is large, standard errors are too small",
    "record i_c as well",
)


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


class Passed(NamedTuple):
    """What passed: axes and signals in the rig's order, its sample rate [Hz], and findings."""

    axes: tuple[str, ...]
    sample_rate: float
    signals: Signals
    findings: list[Finding]


def gated(
    where: str,
    rig: Rig | None,
    axes: tuple[str, ...],
    sample_rate: float,
    signals: Signals,
    period: int | None,
    allow: Collection[str],
) -> Passed:
    """Hold what was recorded against all that is known of it.

    Parameters
    ----------
    where : str
        For the messages.
    rig : Rig, optional
        As in `Record.load`, and so is `allow`.
    axes : tuple of str
    sample_rate : float
        [Hz].
    signals : dict
        They are not changed.
    period : int, optional
        Samples per period, if it was stated.

    Raises
    ------
    RecordError
        If a gate refuses a value.
    """
    checks.require_length(where, len(next(iter(signals.values()))), period)
    checks.require_finite(where, columns_of(axes, signals))
    findings: list[Finding] = []
    if rig is not None:
        axes, signals, findings = _of_rig(where, rig, axes, signals)
        sample_rate, more = checks.sample_rate_of(where, None, sample_rate, rig)
        findings += more
        for signal in ("y", "r"):
            if signal in signals:
                is_allowed = "travel" in allow
                findings += checks.require_metres(where, signal, axes, signals[signal], rig, is_allowed=is_allowed)
        if "y" in signals:
            findings += checks.findings_of_means(axes, signals["y"], rig)
    columns = dict(columns_of(axes, signals))
    for channel, values in columns.items():
        if channel.startswith("i_"):
            findings += checks.require_ampere(where, channel, values, rig, is_allowed="current" in allow)
        if not channel.startswith(("i_e.", "r.")):
            checks.require_alive(where, channel, values)
            checks.require_moving(where, channel, values)
        if channel in signals:
            checks.require_size(where, channel, values)
    findings += checks.findings_of_clipping(where, columns)
    if "y" not in signals:
        read = [name for name in signals if name not in ("i_e", "r", "i_ref")]
        findings.append(WITHOUT_Y(channels=read))
        findings += [] if "i_c" in signals else [LOOP_NOISE_NOT_RECORDED()]
    elif "i_c" not in signals:
        findings.append(WITHOUT_I_C())
        if rig is not None and "i_c" in rig.controller.signals:
            findings.append(READ_WITHOUT_I_C())
    return Passed(axes, sample_rate, signals, findings)


def columns_of(axes: tuple[str, ...], signals: Signals) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Every channel with its values, shape (N,)."""
    for signal, array in signals.items():
        if signal in SIGNALS:
            yield from ((f"{signal}.{axis}", array[:, j]) for j, axis in enumerate(axes))
        else:
            yield signal, array[:, 0]


def as_array(where: str, signal: str, values: ArrayLike) -> NDArray[np.float64]:
    """An array of real numbers; RecordError where it is none."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RecordError(f"{where}: {signal} is not an array of real numbers ({error}); give N x axes") from None


def require_further(where: str, name: str, column: NDArray[np.float64], samples: int, axes: Collection[str]) -> None:
    """Refuse a further channel of another name or shape."""
    own = Channel.of(name)
    is_further = own is not None and (own.signal.name in FURTHER or own.signal.name == "y" and own.place not in axes)
    if not is_further:
        expected = ", ".join(FURTHER)
        raise RecordError(f"{where}: {name} is no further channel; expected {expected} or y with an axis or sensor")
    if column.shape != (samples,):
        raise RecordError(f"{where}: {name} has the shape {column.shape}, expected ({samples},), as y has samples")


def require_driven(where: str, is_known: bool, driving: Signals) -> None:
    """Refuse a record as a frequency response where i_e is not known, or nothing moves that drives it."""
    if not is_known:
        raise RecordError(f"{where}: i_e was not logged; load the record with its rig, whose controller rebuilds it")
    if not driving:
        raise RecordError(
            f"{where}: a free response: nothing drives it, so that there is no input that y and i_c could be the "
            "response to; expected i_e or r that moves. Excite the loop, or identify the record as it is"
        )


def _of_rig(
    where: str, rig: Rig, axes: tuple[str, ...], signals: Signals
) -> tuple[tuple[str, ...], Signals, list[Finding]]:
    """Axes and signals in the rig's order."""
    wanted = tuple(rig.axes)
    order = checks.order_of_axes(where, axes, wanted, "the rig")
    checks.require_known_outputs(where, [name for name in signals if name not in SIGNALS], rig)
    if axes == wanted:
        return axes, signals, []
    turned = {name: own[:, order] if name in SIGNALS else own for name, own in signals.items()}
    return wanted, turned, [checks.AXES_REORDERED(found=axes, wanted=wanted)]
