"""Pictures of the report, each as the source of an HTML image: SVG with its letters as curves, needing no font."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from ambid.diagnosis import Comparison, Diagnosis, Localisation, Ranking
from ambid.diagnosis.localisation import SHAPED
from ambid.plot import (
    plot_comparison,
    plot_growth,
    plot_misfit_map,
    plot_needed,
    plot_ranking,
    plot_staircase,
    worst_stretch,
)
from ambid.plot.needed import HALF, SEEN
from ambid.plot.signals import legend
from ambid.plot.style import LABEL, new_figure
from ambid.record import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

MOST_MAPS = 3
PAGE = 9.0
"""Width of a picture that fills the page [inch]."""


@dataclass(frozen=True)
class Picture:
    """An image and what it says.

    Attributes
    ----------
    source : str
        Data URI.
    caption : str
    percent : float
        Width, of the page's.
    """

    source: str
    caption: str
    percent: float


def as_picture(figure: Figure | SubFigure, caption: str) -> Picture:
    """Draw a figure as SVG within the page; dense clouds of points are pixels in it."""
    import matplotlib

    stream = BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": "ambid"}):
        figure.savefig(stream, format="svg", dpi=160, metadata={"Date": None})  # type: ignore[union-attr]
    source = f"data:image/svg+xml;base64,{base64.b64encode(stream.getvalue()).decode()}"
    return Picture(source, caption, 100.0 * figure.get_figwidth() / PAGE)  # type: ignore[union-attr]


def maps(where: Localisation) -> Iterator[Picture]:
    """The misfit map of the worst records, and the growth where there are several amplitudes."""
    worst = sorted(range(len(where.maps)), key=lambda k: -float(np.nanmax(where.maps[k].misfit)))[:MOST_MAPS]
    for k in sorted(worst):
        found, ax = where.maps[k], plot_misfit_map(where, k)
        yield as_picture(
            ax.figure,
            f"Misfit map of the base model on {found.record}: each channel in each band, judged against its own noise; "
            "grey cells hold no more than chance may bring.",
        )
    if np.isfinite(where.exponent):
        ax = plot_growth(where)
        yield as_picture(
            ax.figure,
            "What the base model leaves unexplained against the amplitude of the excitation; a power of 1 is a linear "
            "effect, a power of 3 a cubic one.",
        )


def ranking(found: Ranking) -> Picture:
    """The ranked candidates."""
    ax = plot_ranking(found)
    return as_picture(
        ax.figure,
        "The misfit that each candidate predicts, between what it is now and noise alone, and the part of the excess "
        "misfit that it would take away. Grey dots may be chance, hollow ones can hardly be told from the first.",
    )


def staircase(diagnosis: Diagnosis) -> Picture:
    """The falling error."""
    return as_picture(
        plot_staircase(diagnosis)[0].figure,
        "The falling error, step by step, against noise alone, with the fit of y below; and where the parameters of "
        "the base model went, with 95 % intervals, beside the values of the rig file.",
    )


def needed(where: Localisation, axes: tuple[str, ...]) -> Picture | None:
    """The shape of what is missing; None where no band holds more than noise to draw it from."""
    if not where.ports or not len(where.ports[0].needed) or np.nanmax(where.maps[where.worst].misfit) <= SEEN:
        return None
    port = where.ports[0]
    if port.share < HALF:
        return None
    best = port.terms[0] if port.terms else None
    if best is None:
        shape = "No simple shape is tried at this port."
    elif best.share > SHAPED:
        shape = f"The best simple shape, {best.shape}, explains {100 * best.share:.0f} % of the excess misfit."
    else:
        shape = (
            f"No simple shape explains it (the best, {best.shape}, {100 * best.share:.0f} % of the excess misfit): "
            "what is missing is linear with dynamics of its own, comes from another axis, or is more than one thing."
        )
    return as_picture(
        plot_needed(where, axes=axes)[0].figure,
        f"The signal that the base model would need as {port.meaning}, so that it met the measurement, from the bands "
        f"whose misfit is more than {SEEN:g} times noise. What K_i, K_s and tau_e can absorb is taken out. {shape}",
    )


def before_and_after(before: Comparison, after: Comparison | None) -> Iterator[Picture]:
    """Measured against simulated, of the record, displacement and current that the base model missed most."""
    index = int(np.argmax([record.misfit for record in before.records]))
    rows, is_response = before.records[index].channels, isinstance(before.records[index].record, FrequencyResponse)
    stages = [("base model", before)] + ([("last model", after)] if after is not None else [])
    for signal in ("y.", "i_c."):
        own = [c for c in rows if c.channel.startswith(signal)]
        if not own:
            continue
        channel = max(own, key=lambda c: c.residual_rms / c.noise_rms if c.noise_rms > 0.0 else c.residual_rms).channel
        figure = new_figure(9.0, 4.0)
        panels = figure.subplots(2, len(stages), sharex=True, height_ratios=[3, 1.6], squeeze=False)
        stretch = None if is_response else worst_stretch(before, index, channel)
        for k, (stage, comparison) in enumerate(stages):
            above, below = plot_comparison(comparison, index, channel, list(panels[:, k]), stretch=stretch)
            above.set_title(f"{stage}, {above.get_title(loc='left')}", fontsize=LABEL, loc="left")
        legend(figure, *panels[:, 0])
        yield as_picture(
            figure,
            f"{channel} of {before.records[index].record.name}, "
            + ("by the excitation" if is_response else "in the stretch of one period")
            + " where the base model misses most; the residual below, with the band of the noise."
            + (" The residuals before and after have scales of their own." if after is not None else ""),
        )
