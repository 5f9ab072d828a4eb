"""The misfit input by output: which excitation is answered wrongly, at which output, with which sign."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambid.diagnosis import MisfitMatrix
from ambid.errors import InputError
from ambid.plot.style import LABEL, NOTHING, SMALL, dress, head, new_figure, short_number
from ambid.results import band_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIGNS = {1: "+", -1: "−", 0: ""}


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
        panel.set_facecolor(NOTHING)
        panel.pcolormesh(
            np.arange(inputs + 2), np.arange(outputs + 1), shown, norm=norm, cmap="YlOrBr", edgecolors="white", lw=1.0
        )
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
        panel.tick_params(length=0)
        panel.spines[["left", "bottom"]].set_visible(False)
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
