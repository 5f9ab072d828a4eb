"""Measured and modelled frequency responses, with the band of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ambid.arrays import ComplexArray
from ambid.errors import InputError
from ambid.plot.style import BAND, LABEL, MEASURED, SIMULATED, SMALL, dress, new_figure
from ambid.record import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

HIDDEN = 0.3
"""Part of the smallest measured value below which a modelled one is not drawn."""
SIGMAS = 2.0
"""Standard deviations that the band of the noise reaches to each side."""


def plot_frequency_response(
    measured: FrequencyResponse,
    output: str,
    inlet: str,
    simulated: ComplexArray | None = None,
    ax: Sequence[Axes] | None = None,
) -> NDArray[np.object_]:
    """Draw the size of one pair over frequency, and below it what a model leaves of it beside the noise.

    Parameters
    ----------
    measured : FrequencyResponse
    output, inlet : str
        Such as ``y.A_zeta`` and ``i_e.A_zeta``.
    simulated : ndarray, shape (F, outputs, inputs), optional
        Response of a model, such as `RecordComparison.simulated`.
    ax : two Axes, optional
        For the response and for what is left; without a model the second stays with the noise alone.

    Returns
    -------
    ndarray of Axes, shape (2,)

    Raises
    ------
    InputError
        If there is no such pair.
    """
    if output not in measured.outputs or inlet not in measured.inputs:
        raise InputError(f"{measured.name}: no pair {output} / {inlet}; it has {', '.join(measured.pairs)}")
    above, below = new_figure(9.0, 4.2).subplots(2, 1, sharex=True, height_ratios=[3, 1.4]) if ax is None else ax
    o, i = measured.outputs.index(output), measured.inputs.index(inlet)
    _draw_size(above, measured, o, i, simulated)
    known = measured.measured[:, o, i]
    f, std = measured.frequency_hz[known], measured.std[known, o, i]
    below.loglog(f, std, color=MEASURED, lw=3.0, label="noise, sigma")
    if simulated is not None:
        left = np.abs(measured.response - simulated)[known, o, i]
        below.loglog(f, left, ".", color="black", ms=3, label="residual")
    unit = _unit(output, inlet)
    dress(above, title=f"{output} / {inlet}", y=f"[{unit}]")
    dress(below, x="frequency [Hz]", y=f"[{unit}]")
    if ax is None:
        handles = [*above.get_legend_handles_labels()[0], *below.get_legend_handles_labels()[0]]
        above.figure.legend(handles=handles, loc="outside upper right", ncols=5, fontsize=SMALL, frameon=False)
    return np.array([above, below])


def draw_response(measured: FrequencyResponse, simulated: ComplexArray | None = None, title: str = "") -> Figure:
    """Draw the size of every pair: a row an output, a column an input."""
    rows, columns = len(measured.outputs), len(measured.inputs)
    figure = new_figure(2.0 + 2.6 * columns, 1.0 + 1.6 * rows)
    panels = figure.subplots(rows, columns, sharex=True, sharey="row", squeeze=False)
    for o, output in enumerate(measured.outputs):
        for i, inlet in enumerate(measured.inputs):
            _draw_size(panels[o, i], measured, o, i, simulated)
            is_edge = (o == rows - 1, i == 0)
            y = f"{output} [{_unit(output, inlet)}]" if is_edge[1] else ""
            dress(panels[o, i], title=inlet if o == 0 else "", x="frequency [Hz]" if is_edge[0] else "", y=y)
    handles, _ = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles=handles, loc="outside upper right", ncols=3, fontsize=SMALL, frameon=False)
    figure.suptitle(title or f"{measured.name}: frequency response", fontsize=LABEL + 1, x=0.01, ha="left")
    return figure


def _draw_size(ax: Axes, measured: FrequencyResponse, o: int, i: int, simulated: ComplexArray | None) -> None:
    known = measured.measured[:, o, i]
    f, size = measured.frequency_hz[known], np.abs(measured.response[known, o, i])
    reach = SIGMAS * measured.std[known, o, i]
    low = np.maximum(size - reach, 0.1 * size)  # a band down to nothing has no place on a logarithmic scale
    ax.fill_between(f, low, size + reach, facecolor=BAND, lw=0.0, label="noise, ±2 sigma")
    ax.loglog(f, size, ".", color=MEASURED, ms=4, label="measured")
    if simulated is not None:
        seen = np.abs(simulated[known, o, i])
        seen[seen < HIDDEN * size.min(initial=np.inf)] = np.nan
        ax.loglog(f, seen, color=SIMULATED, lw=1.0, label="simulated")


def _unit(output: str, of: str) -> str:
    return f"{'m' if output.startswith('y.') else 'A'}/{'m' if of.startswith('r.') else 'A'}"
