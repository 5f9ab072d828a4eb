"""The gates that a record passes when it is loaded, in their order."""

from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.channels import FURTHER, SIGNALS, Channel
from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.record import checks
from ambid.rig import Rig

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

Signals = dict[str, NDArray[np.float64]]
"""What was recorded, by name: signals of shape (N, n), and further channels of shape (N, 1)."""


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
