"""Signals over time: what was recorded; measured against simulated, the residual under it, the band of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambid.channels import unit_of
from ambid.errors import InputError, did_you_mean
from ambid.model import Model
from ambid.noise import Comparison, compare
from ambid.noise.compared import RecordComparison
from ambid.noise.responses import frequency_responses
from ambid.plot.responses import draw_responses, plot_frequency_response
from ambid.plot.style import (
    AXIS_COLOURS,
    BAND,
    GUIDE,
    MEASURED,
    SIMULATED,
    SMALL,
    check_format,
    dress,
    head,
    new_figure,
    save_figure,
    shown_in,
)
from ambid.record import Measurement, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
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


def plot_comparison(
    comparison: Comparison | tuple[Model, Measurement | Sequence[Measurement]],
    record: int = 0,
    channel: str | None = None,
    ax: Sequence[Axes] | None = None,
    *,
    stretch: tuple[float, float] | None = None,
    before: Model | Comparison | None = None,
) -> NDArray[np.object_]:
    """Draw a readable stretch of one channel: measured and simulated, and the residual with the noise below it.

    Of a frequency response the pair of this channel that is missed most, as `plot_frequency_response` draws it.

    Parameters
    ----------
    comparison : Comparison, or a model with its record or records
    record : int
        Which of the records.
    channel : str, optional
        Such as ``y.A_zeta``; default: the one whose residual is largest in units of its noise.
    ax : two Axes, optional
        For the signals and for the residual.
    stretch : tuple of float, optional
        From and to [s]; default: `worst_stretch`, of the model before where there is one.
    before : Model or Comparison, optional
        Drawn beside, such as the model without an effect; both residuals have one scale.

    Returns
    -------
    ndarray of Axes, shape (2,)

    Raises
    ------
    InputError
        If there is no such record or channel, or the record has nothing in that stretch.
    """
    if not isinstance(comparison, Comparison):
        comparison = compare(*comparison)
    one = _record(comparison, record)
    k = _column(one, channel)
    row = one.channels[k]
    if not one.record.is_in_time:
        found = frequency_responses(comparison, record, [] if before is None else [_model(before)])
        inlet = one.record.inputs[int(np.argmax(np.nansum(found.left(-1)[:, k], axis=0)))]
        return plot_frequency_response(found, row.channel, inlet, ax=ax)
    earlier = comparison.of(before) if isinstance(before, Model) else before
    worst = stretch or worst_stretch(earlier or comparison, record, row.channel)
    span = _span(one.record, worst)
    above, below = new_figure(9.0, 4.2).subplots(2, 1, sharex=True, height_ratios=[3, 1.4]) if ax is None else ax
    residual = np.asarray(one.residual, dtype=np.float64)[span, k]
    simulated = np.asarray(one.simulated - np.nanmean(one.simulated, axis=0), dtype=np.float64)[span, k]
    measured = simulated + residual
    factor, unit = shown_in(row.unit, float(np.nanmax(np.abs(measured), initial=0.0)))
    small, small_unit = shown_in(row.unit, float(np.nanmax(np.abs(residual), initial=0.0)))
    t = one.record.t[span] * 1e3
    above.plot(t, factor * measured, color=MEASURED, lw=3.6, label="measured")
    above.plot(t, factor * simulated, color=SIMULATED, lw=1.1, label="simulated")
    if np.isfinite(row.noise_rms):
        noise = 2.0 * small * row.noise_rms
        below.axhspan(-noise, noise, facecolor=BAND, edgecolor=GUIDE, lw=0.6, ls=":", label="noise, ±2 sigma")
    if earlier is not None:
        was = np.asarray(earlier.records[record].residual)[span, k]
        style: dict[str, Any] = {"color": AXIS_COLOURS[0], "ls": (0, (4, 1.5)), "lw": 1.0}
        above.plot(t, factor * (measured - was), label="simulated before", **style)
        below.plot(t, small * was, label="residual before", **style)
    below.plot(t, small * residual, color="black", lw=0.8, label="residual")
    ceiling = row.noise_ceiling_percent
    title = f"{row.channel}: fit {row.fit_percent:.2f} %"
    title += f" of {ceiling:.2f} %" if np.isfinite(ceiling) else ", ceiling unknown"
    dress(above, title=title, y=f"{row.channel.split('.')[0]} [{unit}]")
    dress(below, x="time [ms]", y=f"[{small_unit}]")
    text = f"residual, rms {small * row.residual_rms:.3g} {small_unit}"
    text += f"; noise {small * row.noise_rms:.3g} {small_unit}" if np.isfinite(row.noise_rms) else ""
    below.set_title(text, fontsize=SMALL, loc="left")
    above.set_xlim(t[0], t[-1])
    below.set_xlim(t[0], t[-1])
    if ax is None:
        above.set_title(_which(one.record, worst, row.channel if stretch is None else ""), fontsize=SMALL, loc="right")
        legend(above.figure, above, below)
    return np.array([above, below])


def worst_stretch(
    comparison: Comparison, record: int = 0, channel: str | None = None, seconds: float = 0.06
) -> tuple[float, float]:
    """Where the residual of a channel is largest when the transient has gone, from and to [s].

    In the second period; without periods, after the first eighth.

    Parameters
    ----------
    comparison : Comparison
    record : int
    channel : str, optional
        Default as in `plot_comparison`.
    seconds : float
        Length of the stretch, but 100 samples at least.
    """
    one = _record(comparison, record)
    if not one.record.is_in_time:
        raise InputError(f"{one.record.name}: a frequency response has no stretch of time; leave the stretch out")
    residual = one.residual[:, _column(one, channel)]
    period, rate, samples = one.record.period, one.record.sample_rate, one.record.samples
    length = min(max(round(seconds * rate), 100), samples)
    first = min(period or samples // 8, samples - length)
    last = max(first, min(first + (period or samples), samples) - length)
    power = np.concatenate([[0.0], np.cumsum(np.nan_to_num(residual) ** 2)])
    starts = np.arange(first, last + 1)
    begin = int(starts[np.argmax(power[starts + length] - power[starts])])
    return begin / rate, (begin + length) / rate


def draw_record(
    comparison: Comparison, record: int = 0, *, stretch: tuple[float, float] | None = None, before: Model | None = None
) -> Figure:
    """Draw all channels of a record over one stretch, a column a signal: displacements, currents, further ones."""
    one = _record(comparison, record)
    title = f"{one.record.name}: measured against simulated"
    if np.isfinite(one.misfit):
        title += f"   (misfit {one.misfit:.2f}, 1 when the model is right)"
    if not one.record.is_in_time:
        return draw_responses(frequency_responses(comparison, record, [] if before is None else [before]), title)
    signals: dict[str, list[str]] = {}
    for c in one.channels:
        signals.setdefault(c.channel.partition(".")[0], []).append(c.channel)
    rows = max(map(len, signals.values()))
    earlier = comparison if before is None else comparison.of(before)
    worst = earlier.records[record].worst.channel
    chosen = stretch or worst_stretch(earlier, record)
    title += f"\n{_which(one.record, chosen, worst if stretch is None else '')}"
    figure = new_figure(6.2 * len(signals), 2.6 * rows + 0.8)
    grid = figure.add_gridspec(2 * rows, len(signals), height_ratios=[3, 1.5] * rows)
    for j, channels in enumerate(signals.values()):
        for i, channel in enumerate(channels):
            above = figure.add_subplot(grid[2 * i, j])
            below = figure.add_subplot(grid[2 * i + 1, j], sharex=above)
            plot_comparison(comparison, record, channel, (above, below), stretch=chosen, before=before)
            above.tick_params(labelbottom=False)
            if i < len(channels) - 1:
                below.set_xlabel("")
            if i == j == 0:
                legend(figure, above, below)
    head(figure, title)
    return figure


def legend(figure: Figure | SubFigure, above: Axes, below: Axes) -> None:
    """One legend for a picture of `plot_comparison`, outside of it."""
    handles = [*above.get_legend_handles_labels()[0], *below.get_legend_handles_labels()[0]]
    across = max(3, int(figure.bbox.width / figure.dpi / 1.45))  # width that a label of the legend takes [inch]
    # labels that stand beside the title; more take two lines
    across = min(across, -(-len(handles) // 2)) if len(handles) > 4 else across
    figure.legend(handles=handles, loc="outside upper right", ncols=across, fontsize=SMALL, frameon=False)


def save_comparison(
    comparison: Comparison, path: str | Path, *, stretch: tuple[float, float] | None = None, before: Model | None = None
) -> list[Path]:
    """Write one picture per record, as `plot_comparison` draws each channel; several records get numbered names.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    path = Path(path)
    check_format(path)
    targets = picture_files(path, len(comparison.records))
    for i, target in enumerate(targets):
        save_figure(draw_record(comparison, i, stretch=stretch, before=before), target)
    return targets


def picture_files(path: Path, records: int) -> list[Path]:
    """Where `save_comparison` draws each of so many records."""
    return [path.with_stem(f"{path.stem}_{i + 1}") for i in range(records)] if records > 1 else [path]


def _span(record: Record, stretch: tuple[float, float]) -> slice:
    """Samples of a stretch."""
    begin, end = (round(time * record.sample_rate) for time in stretch)
    if not (begin >= 0 and begin + 1 < end and begin + 1 < record.samples):
        raise InputError(
            f"{record.name}: stretch {stretch[0]:g} to {stretch[1]:g} s; expected two times, the first before the "
            f"second, from 0 to {record.seconds:g} s"
        )
    return slice(begin, min(end, record.samples))


def _which(record: Record, stretch: tuple[float, float], channel: str) -> str:
    """Which part of a record is shown, of how much, and why."""
    begin, end = stretch
    text = f"{1e3 * begin:.0f} to {1e3 * end:.0f} ms of {1e3 * record.seconds:.0f} ms"
    return f"{text}, where {channel} is missed most" if channel else text


def _record(comparison: Comparison, record: int) -> RecordComparison:
    count = len(comparison.records)
    if not 0 <= record < count:
        raise InputError(f"record = {record}: expected 0 to {count - 1}, the comparison has {count}")
    return comparison.records[record]


def _model(of: Model | Comparison) -> Model:
    return of.model if isinstance(of, Comparison) else of


def _column(one: RecordComparison, channel: str | None) -> int:
    names = [c.channel for c in one.channels]
    if channel is None:
        channel = one.worst.channel
    if channel not in names:
        raise InputError(f"{one.record.name}: no channel {channel}; it has {', '.join(names)}")
    return names.index(channel)


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
