"""The ledger of a diagnosis: how the misfit falls with every effect, and what that did to the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambid.diagnosis import Diagnosis
from ambid.errors import InputError
from ambid.model.parameter import nominal
from ambid.noise.compared import averaged_over
from ambid.plot.style import AXIS_COLOURS, GUIDE, SMALL, dress, misfit_text, new_figure, plain_log

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TRAIN, VALIDATION = AXIS_COLOURS[:2]


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
    styles = ((TRAIN, "o", TRAIN, "-", "train", -9), (VALIDATION, "s", "white", "--", "validation", 9))
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
        ax.plot([0.0, now], [row, row], "-", color=TRAIN, lw=1.2)
        label = "last model, 95 % interval" if first else None
        ax.errorbar(now, row, xerr=np.nan_to_num(half), fmt="o", color=TRAIN, ms=5, capsize=3, label=label)
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
