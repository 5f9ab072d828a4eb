"""The sensitivity of every axis over frequency, with its band and the zones of ISO 14839-3."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ambid.plot.style import AXIS_COLOURS, GUIDE, SMALL, dress, new_figure, plain_log, save_drawn
from ambid.robustness import ZONES, Margins
from ambid.robustness.sensitivity import PLACES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES = ("-", "--", "-.", ":")
FARTHEST = 4.0
"""Times the highest peak above which no interval is drawn: it may reach to instability."""


def plot_sensitivity(margins: Margins, ax: Axes | None = None) -> Axes:
    """Draw ``|S_jj|`` of every axis over frequency, the 95 % band of the draws, peaks, and the zones of ISO 14839-3.

    Parameters
    ----------
    margins : Margins
    ax : Axes, optional
        Default: those of a new figure.

    Returns
    -------
    Axes
    """
    ax = new_figure(9.0, 3.4).add_subplot() if ax is None else ax
    f, low = margins.frequency_hz, 0.05  # below, nothing is drawn: what is of interest is the peak
    for j, own in enumerate(margins.axes):
        colour, peak = AXIS_COLOURS[j % len(AXIS_COLOURS)], own.sensitivity
        if margins.band is not None:
            ax.fill_between(f, *margins.band[:, :, j], color=colour, alpha=0.25, lw=0.0)
        label = f"{own.axis}: {peak.value:.2f} at {peak.frequency_hz:.4g} Hz, zone {own.zone}"
        style = STYLES[j // len(AXIS_COLOURS) % len(STYLES)] if len(margins.axes) > len(AXIS_COLOURS) else STYLES[j]
        ax.plot(f, margins.sensitivity[:, j], style, color=colour, lw=1.3, label=label)
        ax.plot(peak.frequency_hz, peak.value, "o", color=colour, ms=4)
        if peak.ci95 is not None:
            ends = np.minimum(peak.ci95, FARTHEST * peak.value)
            ax.plot([peak.frequency_hz] * 2, ends, "_-", color=colour, ms=7, lw=2.5, alpha=0.6)
    highest = most = max(own.sensitivity.value for own in margins.axes)
    if margins.band is not None:
        highest = min(float(margins.band.max()), FARTHEST * most)
    seen = f[(margins.sensitivity > low).any(axis=1)]
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(seen[0], f[-1])
    ax.set_ylim(low, 1.3 * max(highest, most, ZONES[2][0]))
    for (limit, zone), (_, above) in zip(ZONES[:-1], ZONES[1:], strict=True):
        if isfinite(limit):
            ax.axhline(limit, color=GUIDE, lw=0.8, ls=(0, (6, 3)))
            ax.annotate(
                f"{zone} | {above}", (1.0, limit), xycoords=("axes fraction", "data"), xytext=(4, 0), fontsize=SMALL,
                textcoords="offset points", va="center", color=GUIDE,
            )  # fmt: skip
    title = f"Sensitivity, the loop broken at {PLACES[margins.at]}"
    title += ", 95 % bands" if margins.band is not None else ", nominal"
    dress(ax, title=title, x="frequency [Hz]", y="|S| of one axis, all others closed")
    plain_log(ax.xaxis)
    plain_log(ax.yaxis)
    ax.legend(fontsize=SMALL, frameon=False, loc="lower right")
    return ax


def save_sensitivity(margins: Margins, path: str | Path) -> Path:
    """Write the picture of `plot_sensitivity`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: plot_sensitivity(margins))
