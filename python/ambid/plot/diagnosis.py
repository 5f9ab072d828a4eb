"""What a diagnosis finds: ranked candidates, the residual as it would be with one of them, the ledger of its steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambid.diagnosis import Diagnosis, Prediction, Ranking
from ambid.errors import InputError
from ambid.model.parameter import nominal
from ambid.noise.compared import averaged_over
from ambid.plot.style import (
    AXIS_COLOURS,
    GUIDE,
    LABEL,
    NOTHING,
    SIMULATED,
    SMALL,
    TITLE,
    dress,
    head,
    legend,
    misfit_text,
    new_figure,
    plain_log,
    save_drawn,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAIN, VALIDATION = AXIS_COLOURS[:2]
UNSURE = "#9a9a9a"
LEAST = 0.8
"""Of the scale: a predicted misfit a little below 1 is chance."""
CELL: dict[str, Any] = {"va": "center", "ha": "right", "fontsize": SMALL}


def plot_ranking(ranking: Ranking, ax: Axes | None = None, *, most: int = 12) -> Axes:
    """Draw the misfit that each of the first candidates predicts, between the misfit now and noise alone.

    Parameters
    ----------
    ranking : Ranking
    ax : Axes, optional
        Default: those of a new figure.
    most : int
        So many candidates.

    Returns
    -------
    Axes
        A row each from top to bottom in rank order: a bar from the misfit now down to the predicted one, its end a
        filled dot; hollow where the candidate acts on these data much as the first does, grey where its score may be
        chance. To the right the predicted misfit, and the part of the excess misfit that it takes away.
    """
    from matplotlib.lines import Line2D

    shown = ranking.candidates[:most]
    if ax is None:  # as high as its rows need
        ax = new_figure(9.0, 0.2 * max(len(shown), 3) + 1.3).add_subplot()
    significant = {c.effect.name for c in ranking.significant}
    like_first = set(shown[0].confusable_with) if shown else set()
    now = max(ranking.misfit, 1.0)
    place = ax.get_yaxis_transform()
    for row, candidate in enumerate(shown):
        name, then = candidate.effect.name, max(candidate.predicted_misfit, LEAST)
        colour = MAIN if name in significant else UNSURE
        ax.barh(row, now - then, left=then, height=0.3, color=colour if name in significant else NOTHING, lw=0.0)
        fill = "white" if name in like_first else colour
        ax.plot([then], [row], marker="o", ms=6, mfc=fill, mec=colour, mew=1.4, ls="none", zorder=3)
        # misfit from which on there is an excess to take a part of
        taken = 100.0 * (now - candidate.predicted_misfit) / (now - 1.0) if now > 1.05 else np.nan
        share = _percent(taken)
        ax.text(1.09, row, misfit_text(candidate.predicted_misfit), transform=place, **CELL)
        ax.text(1.20, row, share, transform=place, **CELL)
    ax.text(1.09, -0.95, "predicted", transform=place, style="italic", **CELL)
    ax.text(1.20, -0.95, "of excess", transform=place, style="italic", **CELL)
    ax.axvline(now, color="black", lw=1.2)
    ax.axvline(1.0, color=GUIDE, lw=1.2, ls="--")
    ax.set_xscale("log")
    right = max(now, 2.0)
    ax.set_xlim(LEAST, right * (right / LEAST) ** 0.05)
    plain_log(ax.xaxis)
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_yticks(range(len(shown)), [c.effect.name for c in shown])
    dress(ax, x="misfit J/dof: now (line to the right), then (dot), noise alone (dashed)", grid="x")
    ax.set_title(f"Candidates: misfit {misfit_text(ranking.misfit)} now", fontsize=TITLE, loc="left", pad=16)
    style: dict[str, Any] = {"marker": "o", "ms": 6, "mew": 1.4, "ls": "none"}
    handles = [Line2D([], [], mfc=MAIN, mec=MAIN, label="beyond chance", **style)]
    if like_first:
        text = "acts much like the first"
        handles.append(Line2D([], [], mfc="white", mec=MAIN, label=text, **style))
    if len(significant) < len(ranking.candidates):
        handles.append(Line2D([], [], mfc=UNSURE, mec=UNSURE, label="may be chance", **style))
    below = (0.0, -0.62 / max(len(shown), 3) - 0.08)
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=below, ncols=3, fontsize=SMALL, frameon=False)
    return ax


def save_ranking(ranking: Ranking, path: str | Path) -> Path:
    """Write the picture of `plot_ranking`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: plot_ranking(ranking))


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
        legend(figure, panels[0], across=3)
    return np.array(panels[:channels])


def save_prediction(prediction: Prediction, path: str | Path) -> Path:
    """Write the picture of `plot_prediction`, of the first record.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: plot_prediction(prediction)[0])


def _percent(taken: float) -> str:
    """A part of the excess misfit."""
    if not np.isfinite(taken):
        return "–"
    return f"{min(taken, 100.0):.{0 if 9.95 <= taken < 99.0 else 1}f} %" if taken >= 0.1 else "< 0.1 %"


def plot_staircase(diagnosis: Diagnosis, ax: Sequence[Axes] | None = None) -> NDArray[np.object_]:
    """Draw the misfit of every step against 1, and where the parameters of the base model went.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : two Axes, optional
        For the misfit and for the parameters; default: side by side in a new figure.

    Returns
    -------
    ndarray of Axes, shape (2,)

    Raises
    ------
    InputError
        If the diagnosis took no step.
    """
    steps = diagnosis.history
    if not steps:
        raise InputError(f"no staircase to draw: the diagnosis ended in {diagnosis.verdict} before its first step")
    left, right = new_figure(9.0, 3.4).subplots(1, 2, width_ratios=[1.15, 1.0]) if ax is None else ax
    known = np.array(
        [[s.misfit for s in steps], [np.nan if s.validation_misfit is None else s.validation_misfit for s in steps]],
        dtype=float,
    )
    styles = ((MAIN, "o", MAIN, "-", "train", -9), (VALIDATION, "s", "white", "--", "validation", 9))
    for values, (colour, marker, fill, line, label, aside) in zip(known, styles, strict=True):
        if np.isnan(values).all():
            continue
        left.stairs(values, np.arange(len(values) + 1) - 0.5, baseline=None, color=colour, lw=1.4, ls=line)
        left.plot(values, marker, color=colour, mfc=fill, ms=6, ls="none", label=label)
        place: dict[str, Any] = {"textcoords": "offset points", "fontsize": SMALL}
        for step in np.flatnonzero(np.isfinite(values)):
            side = "right" if aside < 0 else "left"
            offset = (aside, -12 if aside > 0 and values[step] < known[0, step] else 5)
            left.annotate(misfit_text(values[step]), (step, values[step]), xytext=offset, ha=side, **place)
    predicted = [(k, s.predicted_misfit) for k, s in enumerate(steps) if s.predicted_misfit is not None]
    if predicted:
        at, values = zip(*predicted, strict=True)
        left.plot(at, values, "x", color="black", ms=8, mew=1.6, label="predicted by the ranking", zorder=5)
    left.axhline(1.0, color=GUIDE, lw=1.2, ls=":", label="noise alone")
    left.set_yscale("log")
    low, high = left.get_ylim()
    left.set_ylim(low / 1.5, high * 1.5)
    dress(left, title="Misfit J/dof", grid="y")
    plain_log(left.yaxis)
    names = [
        f"{step.change}\nfit of {averaged_over(step.fit_percent)} {step.fit_percent['average']:.2f} %" for step in steps
    ]
    left.set_xticks(range(len(steps)), names)
    left.set_xlim(-0.6, len(steps) - 0.4)
    left.legend(fontsize=SMALL, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.13), ncols=2)
    _parameters(right, diagnosis)
    return np.array([left, right])


def _parameters(ax: Axes, diagnosis: Diagnosis) -> None:
    """What the parameters of the base model are now, in percent of what they were, beside the rig file's values."""
    before = {p.name: p.value for p in diagnosis.history[0].model.parameters if p.value}
    of_rig = {p.name: p.value for p in nominal(diagnosis.model.rig)}
    shared = [p for p in diagnosis.model.parameters if p.name in before and p.prior is None]
    shared = sorted(shared, key=lambda p: -abs(p.value / before[p.name] - 1.0))[:16]  # those that moved most
    shared.sort(key=lambda p: diagnosis.model.names.index(p.name))
    widest = 0.0
    for row, p in enumerate(shared):
        scale = 100.0 / abs(before[p.name])
        own = diagnosis.parameters[p.name]
        half = 0.0 if own.ci95 is None else 0.5 * (own.ci95[1] - own.ci95[0]) * scale
        now = (p.value - before[p.name]) * scale
        first = row == 0
        ax.plot([0.0, now], [row, row], "-", color=MAIN, lw=1.2)
        label = "last model, 95 % interval" if first else None
        ax.errorbar(now, row, xerr=np.nan_to_num(half), fmt="o", color=MAIN, ms=5, capsize=3, label=label)
        widest = max(widest, abs(now) + np.nan_to_num(half))
    reach = 1.5 * widest or 1.0
    for row, p in enumerate(shared):
        if p.name in of_rig:
            at = 100.0 * (of_rig[p.name] - before[p.name]) / abs(before[p.name])
            mark = "d" if abs(at) <= reach else ">" if at > 0.0 else "<"
            label = "rig file (arrow: further off)" if row == 0 else None
            ax.plot(np.clip(at, -reach, reach), row, mark, color=GUIDE, mfc="white", ms=5, label=label, clip_on=False)
    ax.axvline(0.0, color="black", lw=1.0, ls="--", label="base model")
    ax.set_yticks(range(len(shared)), [p.name for p in shared])
    ax.set_ylim(len(shared) - 0.4, -0.6)
    ax.set_xlim(-reach, reach)
    dress(ax, title="Parameters, change in % of the base model's", x="[%]", grid="x")
    ax.legend(fontsize=SMALL, frameon=False, loc="upper left", bbox_to_anchor=(-0.1, -0.13), ncols=2)
