"""The ledger of a diagnosis as a staircase: how the error falls with every effect that is added."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ambid.diagnosis import Diagnosis
from ambid.errors import InputError
from ambid.plot.style import AXIS_COLOURS, GUIDE, SMALL, dress, misfit_text, new_figure, plain_log

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

TRAIN, VALIDATION = AXIS_COLOURS[:2]


def plot_staircase(diagnosis: Diagnosis, ax: Sequence[Axes] | None = None) -> NDArray[np.object_]:
    """Draw the misfit of every step against 1, and the part of y that is missed against the noise ceiling.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : two Axes, optional
        For the misfit and for the missed part; default: side by side in a new figure.

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
    left, right = new_figure(9.0, 3.8).subplots(1, 2) if ax is None else ax
    _stairs(left, [s.misfit for s in steps], [s.validation_misfit for s in steps], misfit_text)
    predicted = [(k, s.predicted_misfit) for k, s in enumerate(steps) if s.predicted_misfit is not None]
    if predicted:
        at, values = zip(*predicted, strict=True)
        left.plot(at, values, "x", color="black", ms=8, mew=1.6, label="predicted by the ranking")
    left.axhline(1.0, color=GUIDE, lw=1.2, ls="--", label="noise alone")
    dress(left, title="Misfit J/dof", grid="y")

    missed = [100.0 - s.fit_percent["average"] for s in steps]
    validation = [100.0 - v["average"] if (v := s.validation_fit_percent) is not None else None for s in steps]
    _stairs(right, missed, validation, lambda value: f"{100.0 - value:.2f} %")
    ceiling = np.nan if diagnosis.fit is None else diagnosis.fit.noise_ceiling_percent["average"]
    if np.isfinite(ceiling):
        right.axhline(100.0 - ceiling, color=GUIDE, lw=1.2, ls="--", label=f"ceiling of the fit, {ceiling:.2f} %")
    dress(right, title="Missed part of y, 100 % − fit (figures: the fit)", y="[%]", grid="y")
    for panel in (left, right):
        panel.set_yscale("log")
        low, high = panel.get_ylim()
        panel.set_ylim(low / 2.0, high * 2.0)
        plain_log(panel.yaxis)
        panel.set_xticks(range(len(steps)), [step.change for step in steps])
        panel.set_xlim(-0.6, len(steps) - 0.4)
        panel.legend(fontsize=SMALL, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.08), ncols=2)
    return np.array([left, right])


def _stairs(ax: Axes, train: Sequence[float], validation: Sequence[float | None], text: Callable[[float], str]) -> None:
    box = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"}
    known = np.array([train, [np.nan if value is None else value for value in validation]], dtype=float)
    styles = ((TRAIN, "o", TRAIN, "-", "train"), (VALIDATION, "s", "white", "--", "validation"))
    for k, (colour, marker, fill, line, label) in enumerate(styles):
        values, others = known[k], known[1 - k]
        if np.isnan(values).all():
            continue
        ax.stairs(values, np.arange(len(values) + 1) - 0.5, baseline=None, color=colour, lw=1.4, ls=line)
        ax.plot(values, marker, color=colour, mfc=fill, ms=6, ls="none", label=label)
        for step in np.flatnonzero(np.isfinite(values)):
            below = others[step] > values[step]
            place: dict[str, Any] = {"xytext": (0, -16 if below else 8), "textcoords": "offset points", "bbox": box}
            ax.annotate(text(values[step]), (step, values[step]), ha="center", fontsize=SMALL, **place)
