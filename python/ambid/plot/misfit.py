"""Where the model fails: maps of the misfit, by channel and by excitation, and its growth with amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambid.diagnosis import Localisation, MisfitMatrix
from ambid.diagnosis.localisation import MisfitMap
from ambid.errors import InputError
from ambid.plot.style import AXIS_COLOURS, GUIDE, LABEL, NOTHING, SMALL, dress, head, new_figure, short_number
from ambid.results import band_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import LogNorm

SIGNS = {1: "+", -1: "−", 0: ""}


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
    image = _cells(ax, np.ma.masked_where(~significant, one.misfit), norm)
    for b, row in enumerate(one.misfit):
        for c, misfit in enumerate(row):
            text = short_number(misfit) if np.isfinite(misfit) else "no line"
            colour = "#8a8a8a" if not significant[b, c] else "white" if norm(misfit) > 0.6 else "black"
            ax.text(c + 0.5, b + 0.5, text, ha="center", va="center", fontsize=SMALL, color=colour)
    ax.set_xticks(np.arange(channels) + 0.5, one.channels)
    ax.set_yticks(np.arange(bands) + 0.5, [band_text(*edges, " – ") for edges in pairwise(one.edges_hz)])
    dress(ax, title=f"{one.record}: misfit by band and channel, in times noise power", y="band [Hz]", grid=None)
    bar = ax.figure.colorbar(image, ax=ax, pad=0.01, fraction=0.03)
    bar.set_label("times noise power (grey: may be chance)", fontsize=LABEL)
    bar.ax.tick_params(labelsize=SMALL)
    return ax


def plot_misfit_matrix(matrix: MisfitMatrix, ax: Sequence[Axes] | None = None) -> NDArray[np.object_]:
    """Draw what each output answers to each excitation beyond the model, a panel for each band.

    Parameters
    ----------
    matrix : MisfitMatrix
    ax : sequence of Axes, optional
        As many as there are bands; default: those of a new figure.

    Returns
    -------
    ndarray of Axes, shape (bands,)
        Rows are outputs, columns excitations; the last column is what follows no excitation. A cell holds power in
        times noise, the darker the more, with the sign of the real part where it has one. Grey cells say nothing.

    Raises
    ------
    InputError
        If there are not as many axes as bands.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    bands, outputs, inputs = matrix.power.shape
    kinds = tuple(dict.fromkeys(name.partition(".")[0] for name in matrix.inputs))
    names = [name if len(kinds) > 1 else name.partition(".")[2] for name in matrix.inputs]
    across = min(3, bands)  # bands side by side
    if ax is None:
        height = 0.75 + -(-bands // across) * (0.15 * outputs + 0.48)
        width = max(7.5, 1.2 + across * (0.55 * inputs + 0.75))  # at least so much that its title has room
        grid = new_figure(width, height).subplots(-(-bands // across), across, sharex=True, sharey=True, squeeze=False)
        panels = list(grid.ravel())
        for unused in panels[bands:]:
            unused.set_visible(False)
    else:
        panels = list(ax)
    if len(panels) < bands:
        raise InputError(f"ax: {len(panels)} axes for {bands} bands; give one for each")
    significant = np.where(matrix.is_told, matrix.power, 0.0)
    largest = max(float(significant.max()), float(np.nanmax(matrix.rest, initial=0.0)))
    norm = LogNorm(1.0, max(100.0, largest), clip=True)
    for b, (panel, edges) in enumerate(zip(panels, pairwise(matrix.edges_hz.tolist()), strict=False)):
        rest = matrix.rest[b][:, None]
        values = np.hstack([np.where(matrix.is_told[b], matrix.power[b], np.nan), np.where(rest > 2.0, rest, np.nan)])
        shown = np.ma.masked_invalid(values)
        _cells(panel, shown, norm)
        for o in range(outputs):
            for i in range(inputs + 1):
                if np.ma.is_masked(shown[o, i]):
                    continue
                sign = SIGNS[int(matrix.sign[b, o, i])] if i < inputs else ""
                colour = "white" if norm(values[o, i]) > 0.6 else "black"
                text = f"{sign}{short_number(values[o, i])}"
                panel.text(i + 0.5, o + 0.5, text, ha="center", va="center", fontsize=SMALL - 1, color=colour)
        panel.axvline(inputs, color="black", lw=1.2)
        panel.set_xticks(np.arange(inputs + 1) + 0.5, [*names, "none"], rotation=40, ha="right", rotation_mode="anchor")
        panel.set_yticks(np.arange(outputs) + 0.5, matrix.outputs)
        panel.set_ylim(outputs, 0)
        dress(panel, title=f"{band_text(*edges, ' – ')} Hz", grid=None)
    if ax is None:
        figure = panels[0].figure
        head(
            figure,
            f"{matrix.record}: what each output answers to each {'/'.join(kinds)} beyond the model, and to none "
            "of them\npower, and the sign of the real part where it has one; grey may be chance",
        )
        bar = figure.colorbar(ScalarMappable(norm, "YlOrBr"), ax=panels[:bands], pad=0.01, fraction=0.03)
        bar.set_label("times noise power", fontsize=LABEL)
        bar.ax.tick_params(labelsize=SMALL)
    return np.array(panels[:bands])


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


def _cells(ax: Axes, values: Any, norm: LogNorm) -> QuadMesh:
    """Draw a masked table, row by row from below: the darker a cell, the more; what is masked is grey."""
    rows, columns = values.shape
    ax.set_facecolor(NOTHING)
    ax.tick_params(length=0)
    ax.spines[["left", "bottom"]].set_visible(False)
    edges = np.arange(columns + 1), np.arange(rows + 1)
    return ax.pcolormesh(*edges, values, norm=norm, cmap="YlOrBr", edgecolors="white", lw=1.0)
