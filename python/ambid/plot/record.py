"""What was recorded, over time: a panel for each signal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ambid.channels import unit_of
from ambid.errors import InputError, did_you_mean
from ambid.plot.style import AXIS_COLOURS, SMALL, dress, new_figure, shown_in
from ambid.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
"""Of the axes, so that they differ in grey too."""


def plot_record(
    record: Record,
    channels: str | Sequence[str] | None = None,
    *,
    stretch: tuple[float, float] | None = None,
    ax: Sequence[Axes] | None = None,
) -> NDArray[np.object_]:
    """Draw the signals of a record over time, each with its axes in a panel of its own.

    Parameters
    ----------
    record : Record
    channels : str or sequence of str, optional
        Signals such as ``y``, or channels such as ``y.A_zeta``; default: all.
    stretch : tuple of float, optional
        From and to [s]; default: the whole record.
    ax : sequence of Axes, optional
        One for each signal; default: those of a new figure.

    Returns
    -------
    ndarray of Axes, shape (signals,)

    Raises
    ------
    InputError
        If there is no such channel, or the record has nothing in that stretch.
    """
    chosen = _chosen(record, channels)
    begin, end = (0.0, record.seconds) if stretch is None else stretch
    t = record.t
    inside = (t >= begin) & (t <= end)
    if inside.sum() < 2:
        raise InputError(f"{record.name}: nothing from {begin:g} to {end:g} s; it lasts {record.seconds:g} s")
    if ax is None:
        own = np.atleast_1d(new_figure(9.0, 0.8 + 1.5 * len(chosen)).subplots(len(chosen), 1, sharex=True))
    else:
        own = np.array(list(ax))
    if len(own) != len(chosen):
        raise InputError(f"{len(own)} axes given; expected one for each of {', '.join(chosen)}")
    for panel, (signal, columns) in zip(own, chosen.items(), strict=True):
        largest = max(float(np.abs(values[inside]).max()) for values in columns.values())
        factor, unit = shown_in(unit_of(signal), largest)
        for k, (name, values) in enumerate(columns.items()):
            style: dict[str, Any] = {"color": AXIS_COLOURS[k % len(AXIS_COLOURS)], "ls": DASHES[k % len(DASHES)]}
            panel.plot(*_thinned(t[inside], factor * values[inside]), lw=0.9, label=name, **style)
        dress(panel, y=f"{signal} [{unit}]")
    dress(own[0], title=record.name, y=own[0].get_ylabel())
    dress(own[-1], x="time [s]", y=own[-1].get_ylabel())
    own[0].set_xlim(t[inside][0], t[inside][-1])
    own[0].legend(fontsize=SMALL, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)
    return own


def _chosen(record: Record, channels: str | Sequence[str] | None) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Columns by signal and axis."""
    columns = record.columns()
    wanted = (channels,) if isinstance(channels, str) else channels
    if wanted is not None:
        signals = dict.fromkeys(name.partition(".")[0] for name in columns)
        for name in wanted:
            if name not in columns and name not in signals:
                near = did_you_mean(name, [*signals, *columns])
                raise InputError(f"{record.name}: no channel {name}; {near}it has {', '.join(columns)}")
        columns = {name: own for name, own in columns.items() if name in wanted or name.partition(".")[0] in wanted}
    found: dict[str, dict[str, NDArray[np.float64]]] = {}
    for name, own in columns.items():
        signal, _, axis = name.partition(".")
        found.setdefault(signal, {})[axis] = own
    return found


def _thinned(t: NDArray[np.float64], x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A channel in so few points that it can be drawn: least and largest of every group, so that no peak is lost."""
    group = -(-2 * len(x) // 20_000)
    if group <= 2:
        return t, x
    count = len(x) // group
    rows = x[: count * group].reshape(count, group)
    first = group * np.arange(count)
    at = np.sort(np.stack([first + rows.argmin(axis=1), first + rows.argmax(axis=1)]), axis=0).T.ravel()
    return t[at], x[at]
