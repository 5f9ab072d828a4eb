"""Where the model fails: maps of the misfit, its growth with amplitude, and the shape of what is missing at a port."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from ambid.arrays import FloatArray
from ambid.diagnosis import Localisation, MisfitMatrix
from ambid.diagnosis.localisation import SHAPED, MisfitMap
from ambid.diagnosis.ports import Port
from ambid.errors import InputError
from ambid.noise.shapes import TERMS, Term
from ambid.plot.style import (
    AXIS_COLOURS,
    AXIS_MARKERS,
    BAND,
    GUIDE,
    LABEL,
    NOTHING,
    SMALL,
    dress,
    head,
    new_figure,
    short_number,
    shown_in,
)
from ambid.results import band_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import LogNorm

SIGNS = {1: "+", -1: "−", 0: ""}
SIGNALS = {
    "s": ("displacement s at the magnet [µm]", 1e6),
    "v": ("velocity ds/dt [mm/s]", 1e3),
    "i_f": ("current i [A]", 1.0),
    "i_ref": ("command i_ref [{unit}]", 1.0),
    "y": ("reading y [µm]", 1e6),
    "s_other": ("± displacement of the other axis [µm]", 1e6),
    "v_other": ("± velocity of the other axis [mm/s]", 1e3),
}
TAKEN_UP = ("s", "i_f", "i_ref", "y")
"""Signals whose gains the model has already: of a shape over them, only what is no straight line is missing."""
PANELS = {
    "force": ("s", "v", "i_f"),
    "current": ("s", "v", "i_ref"),
    "sensor": ("y", "v", "i_f"),
    "reading": ("s", "v", "i_f"),
}
HALF = 0.5
"""Part of the excess misfit that a port, and a shape, must explain to be drawn."""
OTHER_AXIS = " of the other axis"
SEEN = 3.0
"""Misfit of a band, in times noise, beyond which what it needs is more than noise carried back to the port."""


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


def plot_needed(
    found: Localisation | Port, ax: Sequence[Axes] | None = None, *, axes: Sequence[str] = ()
) -> NDArray[np.object_]:
    """Draw the needed signal of the best port against displacement, velocity and current, as means over bins.

    Parameters
    ----------
    found : Localisation or Port
    ax : three Axes, optional
        Default: side by side in a new figure.
    axes : sequence of str
        Names of the axes for the legend; default: their numbers.

    Returns
    -------
    ndarray of Axes, shape (3,)
        Means over bins that hold equally many samples, a marker for each axis, and the band that two thirds of the
        samples of all axes lie in. Where the best shape is one of a single signal and explains more than half, it is
        drawn too, less the straight line that the model's own gains take up; if it is one of the other axis of a
        bearing, that takes the place of the current, its sign as it acts. Of a localisation, only the bands are drawn
        whose misfit is more than `SEEN` times noise.

    Raises
    ------
    InputError
        If there is no port, or it explains less than half of the excess misfit: then its signal is no shape.
    """
    port = found if isinstance(found, Port) else _best_in_seen_bands(found)
    if not len(port.needed):
        raise InputError("nothing to draw: a frequency response has no signal over time; expected a record in time")
    if port.share < HALF:
        raise InputError(
            f"nothing to draw: a {port.name} explains {100 * port.share:.0f} % of the excess misfit; a shape needs "
            "more than half"
        )
    panels = new_figure(9.0, 2.9).subplots(1, 3, sharey=True) if ax is None else ax
    factor, unit = shown_in(port.unit, float(np.abs(port.needed).max()))
    names = list(axes) or [f"axis {k + 1}" for k in range(port.needed.shape[1])]
    for panel, key in zip(panels, _keys(port), strict=True):
        label, scale = SIGNALS[key]
        label = label.format(unit=port.unit)  # a command is in the unit of the port that it acts at
        x = _signed(port, key)
        centres, _, low, high = _bins(x, port.needed)
        spread = {"facecolor": BAND, "lw": 0.0, "label": "two thirds of the samples"}
        panel.fill_between(scale * centres, factor * low, factor * high, **spread)
        for k, name in enumerate(names):
            style: dict[str, Any] = {"color": AXIS_COLOURS[k % len(AXIS_COLOURS)], "label": name}
            style |= {"ms": 4.5, "mfc": "white", "mew": 1.0, "lw": 0.8}
            at, means, _, _ = _bins(x[:, k], port.needed[:, k])
            panel.plot(scale * at, factor * means, marker=AXIS_MARKERS[k % len(AXIS_MARKERS)], **style)
        curve = _curve(port, key)
        if curve is not None:
            term, at, values = curve
            label_of = f"{term.shape}, less its line" if key in TAKEN_UP else term.shape
            panel.plot(scale * at, factor * values, "--", color="black", lw=1.8, label=label_of)
        panel.axhline(0.0, color="black", lw=0.5)
        dress(panel, x=label)
    panels[0].set_ylabel(f"needed {port.name} [{unit}]", fontsize=LABEL)
    if ax is None:
        handles = {h.get_label(): h for panel in panels for h in panel.get_legend_handles_labels()[0]}
        panels[0].figure.legend(
            handles=handles.values(), loc="outside upper left", ncols=len(handles), fontsize=SMALL, frameon=False
        )
    return np.array(list(panels))


def _cells(ax: Axes, values: Any, norm: LogNorm) -> QuadMesh:
    """Draw a masked table, row by row from below: the darker a cell, the more; what is masked is grey."""
    rows, columns = values.shape
    ax.set_facecolor(NOTHING)
    ax.tick_params(length=0)
    ax.spines[["left", "bottom"]].set_visible(False)
    edges = np.arange(columns + 1), np.arange(rows + 1)
    return ax.pcolormesh(*edges, values, norm=norm, cmap="YlOrBr", edgecolors="white", lw=1.0)


def _best_in_seen_bands(found: Localisation) -> Port:
    """The best port, its needed signal without the lines of bands that hold little but noise."""
    if not found.ports:
        raise InputError("no needed signal to draw: the localisation has no port")
    port, over = found.ports[0], found.maps[found.worst]
    worst = np.nan_to_num(over.misfit).max(axis=1)
    spectrum = rfft(port.needed, axis=0)
    hertz = over.line_hz * np.arange(len(spectrum))
    band = np.clip(np.searchsorted(over.edges_hz, hertz, side="right") - 1, 0, len(worst) - 1)
    spectrum[worst[band] <= SEEN] = 0.0
    return replace(port, needed=irfft(spectrum, n=len(port.needed), axis=0))


def _bins(x: FloatArray, needed: FloatArray) -> FloatArray:
    """Means of x and of the needed signal, and the 1/6 and 5/6 quantiles, over bins of equally many samples."""
    order = np.argsort(x, axis=None)
    parts = zip(*(np.array_split(own.ravel()[order], 15) for own in (x, needed)), strict=True)
    return np.array([(a.mean(), b.mean(), *np.quantile(b, [1 / 6, 5 / 6])) for a, b in parts]).T


def _keys(port: Port) -> tuple[str, ...]:
    """Signals of the three panels; that of the other axis where the best shape is one of it."""
    keys, best = PANELS[port.name], port.terms[0] if port.terms else None
    if best is None or best.share <= SHAPED or not best.shape.endswith(OTHER_AXIS):
        return keys
    return (*keys[:2], "s_other" if best.shape == f"s{OTHER_AXIS}" else "v_other")


def _signed(port: Port, key: str) -> FloatArray:
    """A signal to draw against; of the other axis, with the sign by which it acts on this one."""
    return port.against[key] * np.sign(port.terms[0].coefficients) if key.endswith("_other") else port.against[key]


def _curve(port: Port, key: str) -> tuple[Term, FloatArray, FloatArray] | None:
    """The best shape over one signal, mean of the axes; None where it takes another signal or explains little."""
    if not port.terms or port.terms[0].share <= HALF:
        return None
    term = port.terms[0]
    x = np.sort(port.against[key], axis=0)
    try:
        shape = TERMS[port.name][term.shape].of({key: x})
    except KeyError:
        return None
    signed = np.abs(term.coefficients) if key.endswith("_other") else term.coefficients
    at, values = x.mean(axis=1), (shape * signed).mean(axis=1)
    return term, at, values - np.polynomial.Polynomial.fit(at, values, 1)(at) if key in TAKEN_UP else values
