"""Measured and modelled frequency responses, with the band of the noise: size, phase, and what a model leaves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambid import channels
from ambid.arrays import FloatArray
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.responses import Modelled, Responses, frequency_responses
from ambid.plot.style import (
    AXIS_COLOURS,
    BAND,
    GUIDE,
    MEASURED,
    SIMULATED,
    dress,
    head,
    legend,
    new_figure,
    plain_log,
    save_drawn,
)
from ambid.record import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIGMAS = 2.0
"""Standard deviations that the band of the noise reaches to each side; what is smaller has no phase to be seen."""
HIDDEN = 0.3
"""Part of the smallest measured value below which a modelled one is not drawn."""
DOTS: dict[str, Any] = {"marker": "o", "ls": "none", "ms": 3.2, "mfc": "white", "mec": "#404040", "mew": 0.7}
STYLES: tuple[dict[str, Any], ...] = (
    {"color": SIMULATED, "ls": "-", "lw": 1.3, "zorder": 4},
    {"color": AXIS_COLOURS[0], "ls": (0, (5, 2)), "lw": 1.3, "zorder": 3},
    {"color": GUIDE, "ls": ":", "lw": 1.3, "zorder": 3},
)
"""Of the model and of those before it: dashed and dotted, so that they differ in grey too."""
MARKS = ("o", "x", "+")
"""Of what each of them leaves."""


def plot_frequency_response(
    found: Comparison | Responses | FrequencyResponse,
    output: str | None = None,
    inlet: str | None = None,
    *,
    record: int = 0,
    before: Model | Sequence[Model] = (),
    ax: Sequence[Axes] | None = None,
) -> NDArray[np.object_]:
    """Draw one pair over frequency: size and phase, measured and modelled, and what each model leaves beside the noise.

    Parameters
    ----------
    found : Comparison, Responses or FrequencyResponse
        Of a frequency response alone there is no model to draw.
    output, inlet : str, optional
        Such as ``y.A_zeta`` and ``i_e.A_zeta``; default: the pair that the model, or the one before it, misses most.
    record : int
        Which of the records of a comparison.
    before : Model or sequence of Model
        Drawn beside the model of a comparison, such as the one without the effect.
    ax : three Axes, optional
        For the size, the phase, and what is left; default: those of a new figure. Of two the phase is left out.

    Returns
    -------
    ndarray of Axes, shape (3,)

    Raises
    ------
    InputError
        If there is no such record or pair.
    RecordError
        If the record gives no frequency response.
    """
    compared = _responses(found, record, before)
    measured = compared.measured
    worst = compared.worst if compared.modelled else (measured.outputs[0], measured.inputs[0])
    output, inlet = output or worst[0], inlet or worst[1]
    o, i = compared.place(output, inlet)
    own = new_figure(9.0, 6.2).subplots(3, 1, sharex=True, height_ratios=[3, 1.6, 1.6]) if ax is None else ax
    size, *phases, left = own
    _draw_size(size, compared, o, i)
    for phase in phases:
        _draw_phase(phase, compared, o, i)
        dress(phase, y="phase [°]")
    _draw_left(left, compared, o, i)
    unit = unit_of(output, inlet)
    dress(size, title=f"{measured.name}: {output} by {inlet}", y=f"magnitude [{unit}]")
    dress(left, x="frequency [Hz]", y=f"residual [{unit}]")
    plain_log(left.xaxis)
    if ax is None:
        legend(size.figure, size, left)
    return np.array(list(own))


def draw_responses(compared: Responses, title: str = "") -> Figure:
    """Draw size and phase of every pair: a row an output, a column an input."""
    measured = compared.measured
    rows, columns = len(measured.outputs), len(measured.inputs)
    figure = new_figure(max(5.0, 1.0 + 2.3 * columns), 0.9 + 1.72 * rows)
    grid = figure.add_gridspec(2 * rows, columns, height_ratios=[1.9, 1.0] * rows)
    size = None
    for o, output in enumerate(measured.outputs):
        first = None
        for i, inlet in enumerate(measured.inputs):
            size = figure.add_subplot(grid[2 * o, i], sharey=first)
            phase = figure.add_subplot(grid[2 * o + 1, i], sharex=size)
            _draw_size(size, compared, o, i)
            _draw_phase(phase, compared, o, i)
            unit = f"{output}\n[{unit_of(output, inlet)}]" if i == 0 else ""
            dress(size, title=f"by {inlet}" if o == 0 else "", y=unit)
            dress(phase, x="frequency [Hz]" if o == rows - 1 else "", y="[°]" if i == 0 else "")
            size.tick_params(labelbottom=False, labelleft=i == 0)
            phase.tick_params(labelbottom=o == rows - 1, labelleft=i == 0)
            first = first or size
    if size is not None:
        legend(figure, size)
    head(figure, title or f"{measured.name}: frequency responses")
    return figure


def save_responses(compared: Responses, path: str | Path) -> Path:
    """Write the picture of `draw_responses`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: draw_responses(compared))


def _responses(
    found: Comparison | Responses | FrequencyResponse, record: int, before: Model | Sequence[Model]
) -> Responses:
    if isinstance(found, FrequencyResponse):
        return Responses(found, ())
    if isinstance(found, Comparison):
        return frequency_responses(found, record, [before] if isinstance(before, Model) else before)
    return found


def _draw_size(ax: Axes, compared: Responses, o: int, i: int) -> None:
    measured = compared.measured
    known = measured.measured[:, o, i]
    f, size, std = measured.frequency_hz[known], np.abs(measured.response[known, o, i]), measured.std[known, o, i]
    low = np.maximum(size - SIGMAS * std, 0.1 * size)  # a band down to nothing has no place on a logarithmic scale
    ax.fill_between(f, low, size + SIGMAS * std, facecolor=BAND, lw=0.0, label=f"noise, ±{SIGMAS:g} sigma")
    seen = size > SIGMAS * std
    ax.loglog(f[~seen], size[~seen], ".", color=MEASURED, ms=3.0, mew=0.0)
    ax.loglog(f[seen], size[seen], label="measured", **DOTS)
    for own, style in zip(compared.modelled, STYLES, strict=False):
        drawn = np.abs(own.response[:, o, i])
        name = own.name if drawn.any() else f"{own.name}: nothing"
        drawn[drawn < HIDDEN * size.min(initial=np.inf)] = np.nan
        ax.loglog(own.frequency_hz, drawn, label=name, **style, **_marked(own, measured))


def _draw_phase(ax: Axes, compared: Responses, o: int, i: int) -> None:
    measured = compared.measured
    seen = np.nan_to_num(np.abs(measured.response[:, o, i]) / measured.std[:, o, i]) > SIGMAS
    angle = np.degrees(np.angle(measured.response[seen, o, i]))
    ax.semilogx(measured.frequency_hz[seen], angle, **DOTS)
    for own, style in zip(compared.modelled, STYLES, strict=False):
        size = np.abs(own.response[:, o, i])
        phase_deg = np.where(size > 0.0, np.degrees(np.angle(own.response[:, o, i])), np.nan)
        if _is_sampled(own, measured):  # by a simulation, whose phase beside larger lines is as little known
            phase_deg[~seen] = np.nan
        ax.semilogx(own.frequency_hz, unbroken(phase_deg), **style, **_marked(own, measured))
    ax.set_ylim(-200.0, 200.0)
    ax.set_yticks([-180, 0, 180])


def _draw_left(ax: Axes, compared: Responses, o: int, i: int) -> None:
    measured = compared.measured
    known = measured.measured[:, o, i]
    f = measured.frequency_hz[known]
    ax.loglog(f, measured.std[known, o, i], color=BAND, lw=3.0, label="noise, sigma")
    for own, style, mark in zip(compared.modelled, STYLES, MARKS, strict=False):
        left = np.abs(measured.response - own.at_measured)[known, o, i]
        label = f"residual of {own.name}"
        ax.loglog(f, left, mark, color=style["color"], ms=3.0, mew=0.7, mfc="none", label=label, zorder=style["zorder"])


def _marked(own: Modelled, measured: FrequencyResponse) -> dict[str, Any]:
    """Dots on the line of a model that is known at the measured frequencies alone."""
    return {"marker": ".", "ms": 3.5} if _is_sampled(own, measured) else {}


def _is_sampled(own: Modelled, measured: FrequencyResponse) -> bool:
    return len(own.frequency_hz) == len(measured.frequency_hz)


def unbroken(degrees: FloatArray) -> FloatArray:
    """Phases without a line where they turn over from 180 to -180 degrees."""
    joined = degrees.copy()
    joined[1:][np.abs(np.diff(degrees)) > 180.0] = np.nan
    return joined


def unit_of(output: str, of: str) -> str:
    """SI unit of a response."""
    return f"{channels.unit_of(output)}/{channels.unit_of(of)}"
