"""The ranked candidates as bars."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from ambid.diagnosis import Candidate, Ranking
from ambid.diagnosis.ranking import ALPHA
from ambid.plot.style import LABEL, SMALL, dress, misfit_text, new_figure, save_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST = 12
FIRST, LIKE_FIRST, OTHER, CHANCE = "#1f4e8c", "#8fb3d9", "#8fb3d9", "#e4e4e4"


def plot_ranking(ranking: Ranking, ax: Axes | None = None, *, most: int = MOST) -> Axes:
    """Draw the scores of the first candidates, the score that chance would reach, and the misfit each predicts.

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
        Bars from top to bottom in rank order; hatched where these data can hardly tell the candidate from the first,
        pale where its score may be chance.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shown = ranking.candidates[:most]
    ax = new_figure(9.0, 0.26 * max(len(shown), 3) + 1.3).add_subplot() if ax is None else ax
    significant = {c.effect.name for c in ranking.significant}
    like_first = set(shown[0].confusable_with) if shown else set()
    least = [needed_score(c, ranking) for c in shown]
    right = 3.0 * max([*(c.score for c in shown), *least, 10.0])
    for row, (candidate, score) in enumerate(zip(shown, least, strict=True)):
        name = candidate.effect.name
        ax.barh(
            row,
            max(candidate.score, 1.0),
            height=0.72,
            color=CHANCE if name not in significant else FIRST if row == 0 else OTHER,
            edgecolor="black",
            linewidth=0.6,
            hatch="////" if name in like_first else None,
        )
        ax.plot([score, score], [row - 0.46, row + 0.46], color="black", lw=1.6)
        ax.text(
            1.015,
            row,
            misfit_text(candidate.predicted_misfit),
            transform=ax.get_yaxis_transform(),
            va="center",
            fontsize=SMALL,
        )
    ax.text(
        1.015, -0.85, "misfit then", transform=ax.get_yaxis_transform(), va="center", fontsize=SMALL, style="italic"
    )
    ax.set_xscale("log")
    ax.set_xlim(1.0, right)
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_yticks(range(len(shown)), [c.effect.name for c in shown])
    dress(ax, x="score: fall of J that adding it would bring", grid="x")
    ax.set_title(
        f"Candidates when the misfit was {misfit_text(ranking.misfit)}", fontsize=LABEL + 1, loc="left", pad=16
    )
    handles: list[Patch | Line2D] = [
        Line2D([], [], color="black", lw=1.6, label=f"significant beyond ({100 * ALPHA:g} % over the catalogue)"),
        Patch(facecolor=CHANCE, edgecolor="black", lw=0.6, label="may be chance"),
    ]
    if like_first:
        handles.append(
            Patch(facecolor=LIKE_FIRST, edgecolor="black", lw=0.6, hatch="////", label="hardly told from the first")
        )
    ax.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.0, -0.6 / max(len(shown), 3) - 0.06),
        ncols=3,
        fontsize=SMALL,
        frameon=False,
    )
    return ax


def save_ranking(ranking: Ranking, path: str | Path) -> Path:
    """Write the picture of `plot_ranking`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_axes(lambda ax: plot_ranking(ranking, ax), 9.0, path)


def needed_score(candidate: Candidate, ranking: Ranking) -> float:
    """Score beyond which a candidate is significant, over the catalogue and over its own variants."""
    level = np.log(ALPHA / max(1, len(ranking.candidates)))
    return float(brentq(lambda score: candidate.chance_of(score) - level, 0.0, 1e4))
