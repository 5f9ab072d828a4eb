"""Where the model fails: the map of the misfit over frequency and channel, and its growth with amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ambid.diagnosis import Localisation
from ambid.diagnosis.localisation import MisfitMap
from ambid.errors import InputError
from ambid.plot.style import AXIS_COLOURS, GUIDE, LABEL, NOTHING, SMALL, dress, new_figure, short_number
from ambid.results import band_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_misfit_map(
    found: Localisation | Sequence[MisfitMap], record: int = 0, ax: Axes | None = None, *, largest: float = np.nan
) -> Axes:
    """Draw the misfit of every band and channel: the darker, the more; grey is what chance may bring, and says nothing.

    Parameters
    ----------
    found : Localisation or sequence of MisfitMap
        Of the base model, or, such as `Diagnosis.left`, of the last one.
    record : int
        Which of the records.
    ax : Axes, optional
        Default: those of a new figure.
    largest : float
        Misfit of the darkest colour; default: the largest of the map. Two maps to be compared should share it.

    Returns
    -------
    Axes

    Raises
    ------
    InputError
        If there is no such record.
    """
    from matplotlib.colors import LogNorm

    maps = found.maps if isinstance(found, Localisation) else tuple(found)
    count = len(maps)
    if not 0 <= record < count:
        raise InputError(f"record = {record}: expected 0 to {count - 1}, so many records were localised")
    one = maps[record]
    bands, channels = one.misfit.shape
    ax = new_figure(9.0, 0.2 * bands + 0.9).add_subplot() if ax is None else ax
    significant = one.misfit > one.by_chance[:, None]
    norm = LogNorm(1.0, max(100.0, float(np.nanmax([largest, np.nanmax(one.misfit)]))), clip=True)
    image = ax.pcolormesh(
        np.arange(channels + 1),
        np.arange(bands + 1),
        np.ma.masked_where(~significant, one.misfit),
        norm=norm,
        cmap="YlOrBr",
        edgecolors="white",
        lw=1.0,
    )
    for b, row in enumerate(one.misfit):
        for c, misfit in enumerate(row):
            text = short_number(misfit) if np.isfinite(misfit) else "no line"
            colour = "#8a8a8a" if not significant[b, c] else "white" if norm(misfit) > 0.6 else "black"
            ax.text(c + 0.5, b + 0.5, text, ha="center", va="center", fontsize=SMALL, color=colour)
    ax.set_facecolor(NOTHING)
    ax.set_xticks(np.arange(channels) + 0.5, one.channels)
    ax.set_yticks(np.arange(bands) + 0.5, [band_text(*edges, " – ") for edges in pairwise(one.edges_hz)])
    dress(ax, title=f"{one.record}: misfit by band and channel, in times noise power", y="band [Hz]", grid=None)
    ax.tick_params(length=0)
    ax.spines[["left", "bottom"]].set_visible(False)
    bar = ax.figure.colorbar(image, ax=ax, pad=0.01, fraction=0.03)
    bar.set_label("times noise power (grey: may be chance)", fontsize=LABEL)
    bar.ax.tick_params(labelsize=SMALL)
    return ax


def plot_growth(localisation: Localisation, ax: Axes | None = None) -> Axes:
    """Draw how the unexplained response grows with the amplitude of the excitation, beside slopes 1 and 3.

    Parameters
    ----------
    localisation : Localisation
    ax : Axes, optional
        Default: those of a new figure.

    Returns
    -------
    Axes

    Raises
    ------
    InputError
        If the records have one amplitude only, or nothing is unexplained.
    """
    if not np.isfinite(localisation.exponent):
        raise InputError("no growth to draw: expected records of two or more amplitudes with something unexplained")
    ax = new_figure(5.0, 3.4).add_subplot() if ax is None else ax
    seen = sorted((g for g in localisation.growth if g.unexplained > 0.0), key=lambda g: g.amplitude)
    amplitude = np.array([g.amplitude for g in seen])
    unexplained = 1e6 * np.array([g.unexplained for g in seen])
    ax.loglog(amplitude, unexplained, "o-", color=AXIS_COLOURS[0], label=f"measured, power {localisation.exponent:.1f}")
    for power, style in ((1, "--"), (3, ":")):
        guide = unexplained[-1] * (amplitude / amplitude[-1]) ** power
        ax.loglog(amplitude, guide, style, color=GUIDE, lw=1.0, label=f"power {power}")
    for side, values in ((ax.xaxis, amplitude), (ax.yaxis, unexplained)):
        side.set_ticks(values, [f"{value:.3g}" for value in values])
        side.set_ticks([], minor=True)
    dress(ax, title="Growth with amplitude", x="rms of the excitation, in its own unit", y="unexplained y, rms [µm]")
    ax.legend(fontsize=SMALL, frameon=False)
    return ax
