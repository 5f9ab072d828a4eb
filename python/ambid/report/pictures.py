"""Pictures of the report, each as the source of an HTML image: SVG with its letters as curves, needing no font.

Measured against simulated, before and after, is shown record by record, those for validation among them.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from ambid.diagnosis import Comparison, Diagnosis, Localisation, MisfitMatrix, Ranking
from ambid.diagnosis.localisation import SHAPED, MisfitMap
from ambid.errors import RecordError
from ambid.noise import compare, frequency_responses
from ambid.noise.compared import ChannelComparison
from ambid.plot import (
    plot_comparison,
    plot_frequency_response,
    plot_growth,
    plot_misfit_map,
    plot_misfit_matrix,
    plot_needed,
    plot_poles,
    plot_ranking,
    plot_sensitivity,
    plot_staircase,
    worst_stretch,
)
from ambid.plot.misfit import HALF, SEEN
from ambid.plot.signals import legend as signal_legend
from ambid.plot.style import legend, new_figure
from ambid.robustness import Margins, PoleMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

PAGE = 9.0
"""Width of a picture that fills the page [inch]."""
DRAWN = 3
"""Records with pictures of their own, those that the base model misses most: of each they take half a page."""


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


def maps(found: Sequence[MisfitMap], which: str, like: Localisation | None = None) -> Iterator[Picture]:
    """The misfit map of the worst records, by the base or the last model, in the colours of another one's."""
    largest = np.nan if like is None else max(float(np.nanmax(own.misfit)) for own in like.maps)
    worst = sorted(range(len(found)), key=lambda k: -float(np.nanmax(found[k].misfit)))[:3]
    for k in sorted(worst):
        yield as_picture(
            plot_misfit_map(found, k, largest=largest).figure,
            f"Misfit map of the {which} model on {found[k].record}: each channel in each band, judged against its own "
            "noise; grey cells hold no more than chance may bring.",
        )


def growth(where: Localisation) -> Picture | None:
    """The growth with amplitude; None where there is one amplitude."""
    if not np.isfinite(where.exponent):
        return None
    return as_picture(
        plot_growth(where).figure,
        "What the base model leaves unexplained against the amplitude of the excitation; a power of 1 is a linear "
        "effect, a power of 3 a cubic one.",
    )


def matrix(found: MisfitMatrix) -> Picture:
    """The misfit input by output."""
    return as_picture(
        plot_misfit_matrix(found)[0].figure,
        f"What each output of {found.record} answers to each excitation beyond the base model, band by band, in times "
        "noise power, with the sign of the real part where it has one; the last column follows no excitation, grey "
        "cells may be chance.",
    )


def sensitivity(found: Margins) -> Picture:
    """The sensitivity with its zones."""
    return as_picture(
        plot_sensitivity(found).figure,
        "Sensitivity of each axis with all others closed, with its 95 % band by the draws, and the limits between the "
        "zones of ISO 14839-3.",
    )


def poles(found: PoleMap, before: PoleMap | None) -> Picture:
    """The poles, of both models where there are two."""
    return as_picture(
        plot_poles(found, before).figure,
        "Poles of the plant alone and of the closed loop with the "
        + ("base model (before) and the last one (after)" if before is not None else "base model")
        + "; 95 % regions are drawn where they reach beyond their marks.",
    )


def ranking(found: Ranking) -> Picture:
    """The ranked candidates."""
    ax = plot_ranking(found)
    return as_picture(
        ax.figure,
        "The misfit that each candidate predicts, between what it is now and noise alone, and the part of the excess "
        "misfit that it would take away. Grey dots may be chance, hollow ones act much like the first.",
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


def signals(before: Comparison, after: Comparison | None, index: int) -> Picture | None:
    """Measured against simulated in time, of each signal the channel that the base model missed most.

    None of a frequency response, which has no time.
    """
    one = before.records[index]
    if not one.record.is_in_time:
        return None
    groups: dict[str, list[ChannelComparison]] = {}
    for c in one.channels:
        groups.setdefault(c.channel.partition(".")[0], []).append(c)
    channels = [max(own, key=lambda c: c.beyond_noise).channel for own in groups.values()]
    figure = new_figure(PAGE, 2.8)
    panels = figure.subplots(2, len(channels), sharex="col", squeeze=False, height_ratios=[3, 1.6])
    for column, channel in zip(panels.T, channels, strict=True):
        plot_comparison(
            before if after is None else after,
            index,
            channel,
            list(column),
            stretch=worst_stretch(before, index, channel),
            before=None if after is None else before,
        )
    signal_legend(figure, *panels[:, 0])
    caption = (
        f"{' and '.join(channels)} of {one.record.name}, in the stretch where the base model misses most; the residual "
        "below, with the band of the noise."
    )
    return as_picture(figure, caption if after is None else f"{caption} Both residuals are on one scale.")


def responses(before: Comparison, after: Comparison | None, index: int) -> Picture | None:
    """Frequency responses of a record: of each signal the channel that the base model missed most.

    None where the record is too short for them.
    """
    try:
        compared = frequency_responses(
            before if after is None else after, index, [] if after is None else [before.model]
        )
    except RecordError:
        return None
    missed = np.nanmean(compared.left(-1), axis=0)
    pairs = []
    outputs = compared.measured.outputs
    for signal in dict.fromkeys(name.partition(".")[0] for name in outputs):
        rows = [k for k, name in enumerate(outputs) if name.startswith(f"{signal}.")]
        o, i = np.unravel_index(int(np.nanargmax(missed[rows])), missed[rows].shape)
        pairs.append((outputs[rows[o]], compared.measured.inputs[i]))
    figure = new_figure(PAGE, 3.6)
    panels = figure.subplots(3, len(pairs), sharex=True, squeeze=False, height_ratios=[3, 1.4, 1.8])
    for column, pair in zip(panels.T, pairs, strict=True):
        plot_frequency_response(compared, *pair, ax=list(column))
    legend(figure, panels[0, 0], panels[2, 0])
    return as_picture(
        figure,
        f"{' and '.join(f'{output} by {inlet}' for output, inlet in pairs)} of {compared.measured.name}, which the "
        "base model misses most: size with the noise of every measured value, phase, and what is left of them beside "
        "their standard deviation.",
    )


@dataclass(frozen=True)
class Shown:
    """A record with both models.

    Attributes
    ----------
    name, role : str
    worst : str
        The channel that the base model misses most.
    fit, misfit : tuple of float
        Before and after, in one noise; fit is the average over the displacements [%].
    ceiling : float
        Of the fit [%].
    signals, responses : Picture or None
        In time and over frequency; None of a record that is not drawn, or has no such picture.
    """

    name: str
    role: str
    worst: str
    fit: tuple[float, float]
    misfit: tuple[float, float]
    ceiling: float
    signals: Picture | None = None
    responses: Picture | None = None

    @property
    def pictures(self) -> list[Picture]:
        """Those that there are."""
        return [own for own in (self.signals, self.responses) if own is not None]


def before_and_after(diagnosis: Diagnosis, before: Comparison, is_moved: bool) -> list[Shown]:
    """All records in their order; pictures of those that are missed most.

    Parameters
    ----------
    diagnosis : Diagnosis
    before : Comparison
        Of the base model against the records of the diagnosis.
    is_moved : bool
        Whether the last model is another one.
    """
    after = diagnosis.fit if is_moved else None
    sides = [("diagnosis", before, after)]
    if diagnosis.validation:
        known = diagnosis.kept_back
        was = compare(before.model, diagnosis.validation) if known is None else known
        was = was.of(before.model) if was.is_judged else was
        now = None if after is None or not was.is_judged else was.of(after.model).with_own_angles()
        sides.append(("validation", was, now))
    places = [(role, was, now, k) for role, was, now in sides for k in range(len(was.records))]
    misfits = np.nan_to_num([was.records[k].misfit for _, was, _, k in places], nan=-np.inf)
    drawn = set(np.argsort(-misfits, kind="stable")[:DRAWN].tolist())
    return [_shown(*place, is_drawn=own in drawn) for own, place in enumerate(places)]


def _shown(role: str, before: Comparison, after: Comparison | None, k: int, *, is_drawn: bool) -> Shown:
    pair = before.records[k], (before if after is None else after).records[k]
    fits, misfits = [float(own.as_dict()["fit_percent"]["average"]) for own in pair], [own.misfit for own in pair]
    drawn: dict[str, Any] = {}
    if is_drawn:
        drawn = {"signals": signals(before, after, k), "responses": responses(before, after, k)}
    return Shown(
        pair[0].record.name,
        role,
        pair[0].worst.channel,
        (fits[0], fits[1]),
        (misfits[0], misfits[1]),
        float(pair[0].as_dict()["noise_ceiling_percent"]["average"]),
        **drawn,
    )
