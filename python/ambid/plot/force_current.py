"""Picture of a campaign: K_i against bias current, by closed-loop identification and by static loading."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ambid.campaigns import Campaign
from ambid.campaigns.result import STATIC
from ambid.plot.style import new_figure, save_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#1f5fa8", "#63a0d8", "#c03a00", "#ee9a5c", "#3d7a35", "#8fc07f")
MARKERS = ("o", "^", "D", "v")
APART = 0.006
"""Distance of the methods along the abscissa, so that their intervals do not hide each other; of the largest i0."""


def plot_campaign(campaign: Campaign, ax: Axes | None = None) -> Axes:
    """Draw K_i with 95 % intervals against bias current (Fig. 4): a colour per axis, a marker per method.

    Parameters
    ----------
    campaign : Campaign
    ax : Axes, optional
        Default: those of a new figure, ``ax.figure``.

    Returns
    -------
    Axes
    """
    if ax is None:
        ax = new_figure(7.5, 5.0).add_subplot()
    largest = max(point.bias_current(axis) for point in campaign.points for axis in campaign.axes)
    for m, method in enumerate(campaign.methods):
        shift = APART * largest * (m - 0.5 * (len(campaign.methods) - 1))
        static = method == STATIC
        for k, axis in enumerate(campaign.axes):
            found = [
                (point.bias_current(axis) + shift, k_i.value, k_i.value - k_i.ci95[0], k_i.ci95[1] - k_i.value)
                for point, at, by, k_i in campaign.force_current()
                if (at, by) == (axis, method) and k_i.value is not None and k_i.ci95 is not None
            ]
            if not found:
                continue
            i0, value, below, above = zip(*sorted(found), strict=True)
            colour = COLOURS[k % len(COLOURS)]
            ax.errorbar(
                i0,
                value,
                yerr=(below, above),
                color=colour,
                marker="s" if static else MARKERS[m % len(MARKERS)],
                markerfacecolor="white" if static else colour,
                markersize=4,
                linestyle="--" if static else "-",
                linewidth=1.0,
                capsize=3,
                label=f"{axis}, {'static loading' if static else method}",
            )
    ax.set_xlabel("bias current i0 [A]")
    ax.set_ylabel("K_i [N/A]")
    ax.set_title("K_i with 95 % intervals", fontsize=10, loc="left")
    ax.grid(True, lw=0.3, alpha=0.6)
    ax.legend(fontsize=7, ncols=len(campaign.methods), frameon=False)
    return ax


def save_campaign(campaign: Campaign, path: str | Path) -> Path:
    """Write the picture of `plot_campaign`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_axes(lambda ax: plot_campaign(campaign, ax), 7.5, path)
