"""The residual as it is, and as it would be with an effect: power over noise, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambid.diagnosis import Prediction
from ambid.errors import InputError
from ambid.plot.style import (
    AXIS_COLOURS,
    GUIDE,
    LABEL,
    SIMULATED,
    SMALL,
    dress,
    head,
    misfit_text,
    new_figure,
    plain_log,
    save_drawn,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_prediction(prediction: Prediction, record: int = 0, ax: Sequence[Axes] | None = None) -> NDArray[np.object_]:
    """Draw the misfit over frequency as it is and as it would be with an effect, a panel for each channel.

    Parameters
    ----------
    prediction : Prediction
    record : int
        Which of the records.
    ax : sequence of Axes, optional
        As many as there are channels; default: those of a new figure.

    Returns
    -------
    ndarray of Axes, shape (channels,)

    Raises
    ------
    InputError
        If there is no such record, or there are not as many axes as channels.
    """
    count = len(prediction.curves)
    if not 0 <= record < count:
        raise InputError(f"record = {record}: expected 0 to {count - 1}, the prediction has {count}")
    now, then = prediction.curves[record]
    channels = len(now.channels)
    signals = len({name.partition(".")[0] for name in now.channels})
    rows = -(-channels // signals)
    if ax is None:
        figure = new_figure(9.0, 1.2 + 1.35 * rows)
        # a column each for y and i_c, as in the pictures of signals
        panels = list(figure.subplots(rows, signals, sharex=True, sharey=True, squeeze=False).T.ravel())[:channels]
    else:
        panels = list(ax)
    if len(panels) < channels:
        raise InputError(f"ax: {len(panels)} axes for {channels} channels; give one for each")
    for c, (panel, channel) in enumerate(zip(panels, now.channels, strict=False)):
        for own, colour, line in ((now, AXIS_COLOURS[0], "-"), (then, SIMULATED, (0, (4, 1.5)))):
            known = np.isfinite(own.misfit[:, c])
            middle = np.sqrt(own.edges_hz[:-1] * own.edges_hz[1:])[known]
            label, mark = ("now", "o") if own is now else (f"with {prediction.effect}, predicted", "x")
            panel.loglog(middle, own.misfit[known, c], marker=mark, ms=2.5, lw=1.3, label=label, color=colour, ls=line)
        panel.axhline(1.0, color=GUIDE, lw=1.0, ls=":", label="noise alone")
        dress(panel, title=channel)
        panel.title.set_fontsize(LABEL)
    top = max(1.0, *(float(np.nanmax(own.misfit)) for own in (now, then)))
    for panel in panels[:channels]:  # once all are drawn: they may share a scale, which would keep that of the first
        panel.set_ylim(0.3, 1.5 * top)  # few lines may hold less by chance, which says nothing
    if ax is None:
        plain_log(panels[0].xaxis)
        for c, panel in enumerate(panels):
            is_last = c % rows == rows - 1
            panel.set_ylabel("times noise" if c < rows else "", fontsize=LABEL)
            panel.set_xlabel("frequency [Hz]" if is_last else "", fontsize=LABEL)
        text = f"{misfit_text(prediction.misfit_now)} now, {misfit_text(prediction.misfit_then)} predicted"
        head(figure, f"{now.record}: power of the residual; misfit {text} with {prediction.effect}")
        handles = panels[0].get_legend_handles_labels()[0]
        figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=SMALL, frameon=False)
    return np.array(panels[:channels])


def save_prediction(prediction: Prediction, path: str | Path) -> Path:
    """Write the picture of `plot_prediction`, of the first record.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: plot_prediction(prediction)[0])
