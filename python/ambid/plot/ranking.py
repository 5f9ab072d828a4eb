"""The ranked candidates: the misfit that each predicts, between what it is now and noise alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambid.diagnosis import Ranking
from ambid.plot.style import (
    AXIS_COLOURS,
    GUIDE,
    NOTHING,
    SMALL,
    TITLE,
    dress,
    misfit_text,
    new_figure,
    plain_log,
    save_drawn,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FALL = AXIS_COLOURS[0]
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
        colour = FALL if name in significant else UNSURE
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
    handles = [Line2D([], [], mfc=FALL, mec=FALL, label="beyond chance", **style)]
    if like_first:
        text = "acts much like the first"
        handles.append(Line2D([], [], mfc="white", mec=FALL, label=text, **style))
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


def _percent(taken: float) -> str:
    """A part of the excess misfit."""
    if not np.isfinite(taken):
        return "–"
    return f"{min(taken, 100.0):.{0 if 9.95 <= taken < 99.0 else 1}f} %" if taken >= 0.1 else "< 0.1 %"
