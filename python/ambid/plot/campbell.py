"""The Campbell diagram: natural frequencies over the speed of rotation, beside those that were identified."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambid.identification.estimate import NORMAL_95
from ambid.plot.style import AXIS_COLOURS, SMALL, TITLE, dress, new_figure, plain_log, save_drawn
from ambid.robustness import Campbell
from ambid.robustness.whirl import whirl_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RPM = 30.0 / np.pi
WHIRLS: dict[str, dict[str, Any]] = {
    "forward": {"color": AXIS_COLOURS[1], "ls": "-", "marker": "^"},
    "backward": {"color": AXIS_COLOURS[0], "ls": (0, (5, 2)), "marker": "v"},
    "planar": {"color": AXIS_COLOURS[2], "ls": ":", "marker": "o"},
}
"""Lines and marks differ in grey too."""


def plot_campbell(campbell: Campbell, ax: Axes | None = None) -> Axes:
    """Draw natural frequencies over speed, by direction of whirl, those identified at the measured speeds, and 1x.

    Parameters
    ----------
    campbell : Campbell
    ax : Axes, optional
        Default: those of a new figure.

    Returns
    -------
    Axes
        Speeds in rpm below, in rad/s above. Critical speeds, where a branch crosses the frequency of rotation, are
        ringed; bars on the marks are 95 % intervals where they can be seen.
    """
    ax = new_figure(9.0, 4.8).add_subplot() if ax is None else ax
    rpm = campbell.speed * RPM
    for frequency, whirl in zip(campbell.frequency_hz.T, campbell.whirls, strict=True):
        style = {key: WHIRLS[whirl][key] for key in ("color", "ls")}
        ax.plot(rpm, frequency, lw=1.4, label=whirl, zorder=3, **style)
    ax.plot(rpm, rpm / 60.0, color="black", lw=0.9, ls="-.", label="1x, the rotation")
    ring: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 10, "mfc": "none", "mec": "black", "mew": 0.9}
    for met in campbell.critical:
        ax.plot(met.speed * RPM, met.speed / (2.0 * np.pi), label="critical speed", **ring)
    for own in campbell.measured:
        whirl = whirl_of(own.direction)
        style = {"fmt": WHIRLS[whirl]["marker"], "color": WHIRLS[whirl]["color"], "mfc": "white", "ms": 6, "capsize": 3}
        bar = NORMAL_95 * np.nan_to_num(own.std_error_hz)
        ax.errorbar(own.speed * RPM, own.frequency_hz, yerr=bar, label=f"identified, {whirl}", zorder=5, **style)
    drawn = campbell.frequency_hz[np.isfinite(campbell.frequency_hz)]
    seen = np.concatenate([drawn, [own.frequency_hz for own in campbell.measured]])
    ax.set_xlim(rpm[0], rpm[-1])
    ax.set_ylim(0.0, 1.08 * seen.max(initial=1.0))
    if seen.max(initial=1.0) > 8.0 * seen.min(initial=1.0):
        ax.set_yscale("log")
        ax.set_ylim(0.7 * seen.min(), 1.4 * seen.max())
        plain_log(ax.yaxis)
    above = ax.secondary_xaxis("top", functions=(_rad_s, _rpm))
    above.set_xlabel("[rad/s]", fontsize=SMALL)
    above.tick_params(labelsize=SMALL)
    dress(ax, x="speed [rpm]", y="natural frequency [Hz]")
    ax.set_title(f"Campbell diagram of {campbell.model.rig.name}", fontsize=TITLE, loc="left", pad=8)
    handles: dict[str, Any] = {}
    for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
        handles.setdefault(label, handle)
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13), "ncols": 4, "frameon": False}
    ax.legend(handles=list(handles.values()), fontsize=SMALL, **below)
    return ax


def save_campbell(campbell: Campbell, path: str | Path) -> Path:
    """Write the picture of `plot_campbell`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: plot_campbell(campbell))


def _rad_s(rpm: Any) -> Any:
    return rpm / RPM


def _rpm(rad_s: Any) -> Any:
    return rad_s * RPM
