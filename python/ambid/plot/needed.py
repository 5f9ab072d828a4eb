"""The shape of what is missing: the signal that a port would need, against position, velocity and current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.fft import irfft, rfft

from ambid.arrays import FloatArray
from ambid.diagnosis import Localisation
from ambid.diagnosis.localisation import SHAPED
from ambid.diagnosis.ports import Port
from ambid.errors import InputError
from ambid.noise.shapes import TERMS, Term
from ambid.plot.style import AXIS_COLOURS, AXIS_MARKERS, BAND, LABEL, SMALL, dress, new_figure, shown_in

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

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
