"""How the loop stands: sensitivity with the zones of ISO 14839-3, poles with their regions, the Campbell diagram."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtri

from ambid.arrays import ComplexArray
from ambid.identification.estimate import NORMAL_95
from ambid.plot.style import (
    AXIS_COLOURS,
    BAND,
    GUIDE,
    SIMULATED,
    SMALL,
    TITLE,
    dress,
    new_figure,
    plain_log,
    save_drawn,
)
from ambid.robustness import ZONES, Campbell, Margins, PoleMap
from ambid.robustness.sensitivity import PLACES
from ambid.robustness.uncertainty import COVERED
from ambid.robustness.whirl import whirl_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES = ("-", "--", "-.", ":")
FARTHEST = 4.0
"""Times the highest peak above which no interval is drawn: it may reach to instability."""
LINEAR_HZ = 1.0
"""Within this frequency the scales are linear: poles on the real axis have a place, and slow ones are apart."""
RPM = 30.0 / np.pi
WHIRLS: dict[str, dict[str, Any]] = {
    "forward": {"color": AXIS_COLOURS[1], "ls": "-", "marker": "^"},
    "backward": {"color": AXIS_COLOURS[0], "ls": (0, (5, 2)), "marker": "v"},
    "planar": {"color": AXIS_COLOURS[2], "ls": ":", "marker": "o"},
}
"""Lines and marks differ in grey too."""


def plot_sensitivity(margins: Margins, ax: Axes | None = None) -> Axes:
    """Draw ``|S_jj|`` of every axis over frequency, the 95 % band of the draws, peaks, and the zones of ISO 14839-3.

    Parameters
    ----------
    margins : Margins
    ax : Axes, optional
        Default: those of a new figure.

    Returns
    -------
    Axes
    """
    ax = new_figure(9.0, 3.4).add_subplot() if ax is None else ax
    f, low = margins.frequency_hz, 0.05  # below, nothing is drawn: what is of interest is the peak
    for j, own in enumerate(margins.axes):
        colour, peak = AXIS_COLOURS[j % len(AXIS_COLOURS)], own.sensitivity
        if margins.band is not None:
            ax.fill_between(f, *margins.band[:, :, j], color=colour, alpha=0.25, lw=0.0)
        label = f"{own.axis}: {peak.value:.2f} at {peak.frequency_hz:.4g} Hz, zone {own.zone}"
        style = STYLES[j // len(AXIS_COLOURS) % len(STYLES)] if len(margins.axes) > len(AXIS_COLOURS) else STYLES[j]
        ax.plot(f, margins.sensitivity[:, j], style, color=colour, lw=1.3, label=label)
        ax.plot(peak.frequency_hz, peak.value, "o", color=colour, ms=4)
        if peak.ci95 is not None:
            ends = np.minimum(peak.ci95, FARTHEST * peak.value)
            ax.plot([peak.frequency_hz] * 2, ends, "_-", color=colour, ms=7, lw=2.5, alpha=0.6)
    highest = most = max(own.sensitivity.value for own in margins.axes)
    if margins.band is not None:
        highest = min(float(margins.band.max()), FARTHEST * most)
    seen = f[(margins.sensitivity > low).any(axis=1)]
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(seen[0], f[-1])
    ax.set_ylim(low, 1.3 * max(highest, most, ZONES[2][0]))
    for (limit, zone), (_, above) in zip(ZONES[:-1], ZONES[1:], strict=True):
        if isfinite(limit):
            ax.axhline(limit, color=GUIDE, lw=0.8, ls=(0, (6, 3)))
            ax.annotate(
                f"{zone} | {above}", (1.0, limit), xycoords=("axes fraction", "data"), xytext=(4, 0), fontsize=SMALL,
                textcoords="offset points", va="center", color=GUIDE,
            )  # fmt: skip
    title = f"Sensitivity, the loop broken at {PLACES[margins.at]}"
    title += ", 95 % bands" if margins.band is not None else ", nominal"
    dress(ax, title=title, x="frequency [Hz]", y="|S| of one axis, all others closed")
    plain_log(ax.xaxis)
    plain_log(ax.yaxis)
    ax.legend(fontsize=SMALL, frameon=False, loc="lower right")
    return ax


def save_sensitivity(margins: Margins, path: str | Path) -> Path:
    """Write the picture of `plot_sensitivity`.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    return save_drawn(path, lambda: plot_sensitivity(margins))


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
    _mark(ax, poles.open, "plant, the controller off", marker="s", ms=4.5, mfc="none", mew=0.9, color=GUIDE)
    if before is not None:
        _mark(ax, before.closed, "closed loop, before", marker="o", ms=7, mfc="none", mew=1.1, color=AXIS_COLOURS[0])
    _regions(ax, poles)
    label = "closed loop" if before is None else "closed loop, after"
    _mark(ax, poles.closed, label, marker="x", ms=7, mew=1.5, color=SIMULATED, zorder=5)
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
    of_speed: Any = (lambda rpm: rpm / RPM, lambda rad_s: rad_s * RPM)
    above = ax.secondary_xaxis("top", functions=of_speed)
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


def _mark(ax: Axes, poles: ComplexArray, label: str, **style: Any) -> None:
    ax.plot(poles.real / (2.0 * np.pi), poles.imag / (2.0 * np.pi), label=label, ls="none", clip_on=False, **style)


def _regions(ax: Axes, poles: PoleMap) -> None:
    """Ellipses of the covariance; of a real pole a bar along its axis."""
    radius = float(np.sqrt(chdtri(2, 1.0 - COVERED)))
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
