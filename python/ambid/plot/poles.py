"""The poles of a loop: of the plant alone, and of the closed loop with their 95 % regions, before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import chi2

from ambid.arrays import ComplexArray
from ambid.plot.style import AXIS_COLOURS, BAND, GUIDE, SIMULATED, SMALL, dress, new_figure, save_drawn
from ambid.robustness import PoleMap
from ambid.robustness.uncertainty import COVERED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINEAR_HZ = 1.0
"""Within this frequency the scales are linear: poles on the real axis have a place, and slow ones are apart."""
CLOSED: dict[str, Any] = {"marker": "x", "ms": 7, "mew": 1.5, "ls": "none", "color": SIMULATED, "zorder": 5}
BEFORE: dict[str, Any] = {"marker": "o", "ms": 7, "mfc": "none", "mew": 1.1, "ls": "none", "color": AXIS_COLOURS[0]}
OPEN: dict[str, Any] = {"marker": "s", "ms": 4.5, "mfc": "none", "mew": 0.9, "ls": "none", "color": GUIDE}


def plot_poles(poles: PoleMap, before: PoleMap | None = None, ax: Axes | None = None) -> Axes:
    """Draw the upper half of the plane: decay to the left, growth to the right, frequency upwards.

    Parameters
    ----------
    poles : PoleMap
    before : PoleMap, optional
        Of another model, such as the one without an effect.
    ax : Axes, optional
        Default: those of a new figure.

    Returns
    -------
    Axes
        Both scales in Hz, linear up to 1 Hz and logarithmic beyond. The 95 % region of a closed-loop pole is drawn
        around it; where it hides behind the mark, the pole is known better than it can be shown.
    """
    ax = new_figure(9.0, 3.6).add_subplot() if ax is None else ax
    ax.set_xscale("symlog", linthresh=LINEAR_HZ, linscale=0.5)
    ax.set_yscale("symlog", linthresh=LINEAR_HZ, linscale=0.5)
    drawn = [poles.closed, poles.open, *([] if before is None else [before.closed])]
    size = np.concatenate(drawn) / (2.0 * np.pi)
    left, right = 1.6 * max(-size.real.min(), LINEAR_HZ), 1.6 * max(size.real.max(), LINEAR_HZ)
    top = 1.6 * max(size.imag.max(), LINEAR_HZ)
    ax.axvspan(0.0, right, color="#eeeeee", lw=0.0, zorder=0)
    ax.axvline(0.0, color="black", lw=1.0)
    for ratio in (0.01, 0.1, 0.5):  # damping ratios of the guiding lines
        high = np.geomspace(1e-3, 10.0 * top, 400)
        ax.plot(-high * ratio / np.sqrt(1.0 - ratio**2), high, color=GUIDE, lw=0.6, ls=(0, (1, 3)), zorder=1)
        ax.annotate(
            f"{ratio:g}", (-min(top * ratio / np.sqrt(1.0 - ratio**2), left), top), xytext=(2, -9), fontsize=SMALL,
            textcoords="offset points", color=GUIDE,
        )  # fmt: skip
    _mark(ax, poles.open, "plant, the controller off", OPEN)
    if before is not None:
        _mark(ax, before.closed, "closed loop, before", BEFORE)
    _regions(ax, poles)
    _mark(ax, poles.closed, "closed loop" if before is None else "closed loop, after", CLOSED)
    ax.set_xlim(-left, right)
    ax.set_ylim(-0.25 * LINEAR_HZ, top)
    title = f"Poles of {poles.model.rig.name}: shaded is growth, dotted lines are damping ratios"
    dress(ax, title=title, x="real part / 2π [Hz]", y="imaginary part / 2π [Hz]")
    _plain_scales(ax)
    ax.legend(fontsize=SMALL, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=4)
    return ax


def save_poles(poles: PoleMap, path: str | Path, before: PoleMap | None = None) -> Path:
    """Write the picture of `plot_poles`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: plot_poles(poles, before))


def _mark(ax: Axes, poles: ComplexArray, label: str, style: dict[str, Any]) -> None:
    ax.plot(poles.real / (2.0 * np.pi), poles.imag / (2.0 * np.pi), label=label, clip_on=False, **style)


def _regions(ax: Axes, poles: PoleMap) -> None:
    """Ellipses of the covariance; of a real pole a bar along its axis."""
    radius = float(np.sqrt(chi2.ppf(COVERED, 2)))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = radius * np.stack([np.cos(turn), np.sin(turn)])
    label: str | None = "95 % regions"
    for pole, spread in zip(poles.closed, poles.covariance, strict=True):
        if np.isnan(spread).any():
            continue
        values, vectors = np.linalg.eigh(spread)
        x, y = (vectors * np.sqrt(np.maximum(values, 0.0))) @ circle
        around = np.array([pole.real + x, pole.imag + y]) / (2.0 * np.pi)
        ax.fill(*around, facecolor=BAND, edgecolor=AXIS_COLOURS[0], lw=0.8, zorder=4, label=label)
        label = None


def _plain_scales(ax: Axes) -> None:
    """Ticks at powers of ten on both sides of zero, as plain numbers."""
    from matplotlib.ticker import FixedLocator, FuncFormatter

    for axis in (ax.xaxis, ax.yaxis):
        most = max(abs(end) for end in axis.get_view_interval())
        tens = 10.0 ** np.arange(0, np.ceil(np.log10(most)))
        axis.set_major_locator(FixedLocator([*(-tens[::-1]), 0.0, *tens]))
        axis.set_minor_locator(FixedLocator([]))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "−")))
