"""Pictures of a campaign: K_i, K_s and tau_e against bias current, by closed-loop identification and static loading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambid.campaigns import Campaign
from ambid.campaigns.result import STATIC, Runs
from ambid.errors import InputError
from ambid.identification import ParameterEstimate
from ambid.plot.style import (
    AXIS_COLOURS,
    GUIDE,
    LABEL,
    SMALL,
    check_format,
    dress,
    head,
    legend,
    new_figure,
    save_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUANTITIES = {"K_i": (1.0, "N/A"), "K_s": (1e-6, "N/µm"), "tau_e": (1e6, "µs")}
"""Factors and names of the units that they are drawn in."""
MARKERS = ("o", "^", "D", "v")
LINES = ("-", "-.", ":", (0, (5, 1)))


def plot_campaign(campaign: Campaign, quantity: str = "K_i", ax: Sequence[Axes] | None = None) -> NDArray[np.object_]:
    """Draw a quantity with 95 % intervals against bias current (Fig. 4), a panel for each axis.

    Parameters
    ----------
    campaign : Campaign
    quantity : str
        K_i, by every kind of records and by static loading; K_s or tau_e, by every kind of records.
    ax : sequence of Axes, optional
        As many as there are axes, of tau_e one; default: those of a new figure, two by two.

    Returns
    -------
    ndarray of Axes, shape (axes,)
        A marker and a line for each method. In a figure of its own each has a strip below it that shows what hides
        behind a marker: the methods in percent off their mean, with their intervals, and single runs as small crosses.

    Raises
    ------
    InputError
        If the quantity is another one, or there are not as many axes as panels.
    """
    if quantity not in QUANTITIES:
        raise InputError(f"quantity {quantity}: expected one of {', '.join(QUANTITIES)}")
    names = [quantity] if quantity == "tau_e" else [f"{quantity}.{axis}" for axis in campaign.axes]
    across = min(len(names), 2)
    strips: list[Axes | None] = [None] * len(names)
    if ax is None:
        down = -(-len(names) // across)
        figure = new_figure(9.0 if across > 1 else 5.5, 0.7 + 2.9 * down)
        grid = figure.subplots(2 * down, across, sharex=True, squeeze=False, height_ratios=[2.0, 1.0] * down)
        panels, strips = list(grid[::2].ravel()), list(grid[1::2].ravel())
        for unused in [*panels[len(names) :], *strips[len(names) :]]:
            unused.set_visible(False)
    else:
        panels = list(ax)
    if len(panels) < len(names):
        raise InputError(f"ax: {len(panels)} axes for {len(names)} panels; give one for each")
    methods = [method for method in campaign.methods if quantity == "K_i" or method != STATIC]
    axes = campaign.axes[:1] if quantity == "tau_e" else campaign.axes
    factor, unit = QUANTITIES[quantity]
    for panel, strip, name, axis in zip(panels, strips, names, axes, strict=False):
        estimates = {method: dict(_joint(campaign, name, axis, method)) for method in methods}
        for m, method in enumerate(methods):
            # of the largest i0, so that the intervals of the methods do not hide each other
            shift = 0.012 * max(campaign.points[-1].bias_current(axis), 1e-9) * (m - 0.5 * (len(methods) - 1))
            _draw(panel, estimates[method], method, m, shift, dict.fromkeys(estimates[method], 0.0), factor)
            if strip is None:
                continue
            mean = {
                i0: float(np.mean([own[i0].value for own in estimates.values() if i0 in own]))
                for i0 in estimates[method]
            }
            _draw(strip, estimates[method], method, m, shift, mean, 0.0)
            for i0, values in _single(campaign, name, axis, method):
                if i0 in mean:
                    off = 100.0 * (np.array(values) / mean[i0] - 1.0)
                    strip.plot(np.full(len(off), i0 + shift), off, "x", color=GUIDE, ms=3.0, mew=0.6, zorder=1)
        dress(panel, title=name, y=f"[{unit}]")
        if strip is None:
            panel.set_xlabel("bias current i₀ [A]", fontsize=LABEL)
            continue
        strip.axhline(0.0, color=GUIDE, lw=0.8, ls=":")
        dress(strip, y="off their\nmean [%]")
        strip.yaxis.label.set_fontsize(SMALL)
    if ax is None:
        for strip in grid[-1]:
            strip.set_xlabel("bias current i₀ [A]", fontsize=LABEL)
        legend(figure, panels[0])
        title = f"{campaign.folder.name}: {quantity} with 95 % intervals"
        head(figure, f"{title}; small crosses are single runs")
    return np.array(panels[: len(names)])


def campaign_files(path: Path) -> list[Path]:
    """Where `save_campaign` draws each quantity.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    check_format(path)
    return [path, *(path.with_stem(f"{path.stem}_{quantity}") for quantity in list(QUANTITIES)[1:])]


def save_campaign(campaign: Campaign, path: str | Path) -> list[Path]:
    """Write the pictures of `plot_campaign`: K_i by this name, such as ``bench.pdf``, and ``bench_K_s.pdf`` and so on.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    files = campaign_files(Path(path))
    for file, quantity in zip(files, QUANTITIES, strict=True):
        figure: Figure = plot_campaign(campaign, quantity)[0].figure
        save_figure(figure, file)
    return files


def _draw(
    ax: Axes,
    estimates: Mapping[float, ParameterEstimate],
    method: str,
    m: int,
    shift: float,
    mean: Mapping[float, float],
    factor: float,
) -> None:
    """One method on one panel by rising bias current; with a mean, in percent off it."""
    if not estimates:
        return
    colour, is_static = AXIS_COLOURS[m % len(AXIS_COLOURS)], method == STATIC
    i0 = np.array(sorted(estimates))
    rows = [(*(estimates[at].ci95 or ()), estimates[at].value) for at in i0.tolist()]
    low, high, value = np.array(rows, dtype=float).T
    if any(mean.values()):
        middle = np.array([mean[at] for at in i0.tolist()])
        low, high, value = (100.0 * (own / middle - 1.0) for own in (low, high, value))
    else:
        low, high, value = (factor * own for own in (low, high, value))
    ax.errorbar(
        i0 + shift,
        value,
        yerr=(value - low, high - value),
        color=colour,
        marker="s" if is_static else MARKERS[m % len(MARKERS)],
        markerfacecolor="white" if is_static else colour,
        markersize=5,
        linestyle="--" if is_static else LINES[m % len(LINES)],
        linewidth=1.0,
        capsize=5,
        label="static loading" if is_static else f"closed loop, {method}",
    )


def _joint(campaign: Campaign, name: str, axis: str, method: str) -> Iterator[tuple[float, ParameterEstimate]]:
    """Bias current and estimate by all runs of a method together."""
    for point in campaign.points:
        found = point.force_current(method, axis) if name.startswith("K_i") else _of_runs(point.runs, method, name)
        if found is not None and found.value is not None and found.ci95 is not None:
            yield point.bias_current(axis), found


def _of_runs(runs: Sequence[Runs], method: str, name: str) -> ParameterEstimate | None:
    return next((own.joint.parameters[name] for own in runs if own.kind == method), None)


def _single(campaign: Campaign, name: str, axis: str, method: str) -> Iterator[tuple[float, list[float]]]:
    """Bias current, and the estimate of each run by itself."""
    for point in campaign.points:
        for runs in point.runs:
            if runs.kind == method:
                yield point.bias_current(axis), runs.values(name)
