"""Pictures of measured and simulated signals. Every function takes or returns Matplotlib axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ambid.compare import Comparison, RecordComparison
from ambid.errors import InputError

MEASURED, SIMULATED, BAND = "#777777", "#c03a00", "#9ec5e8"
FORMATS = (".png", ".pdf", ".svg")


def plot_channel(comparison: RecordComparison, channel: str, ax: Axes, below: Axes, *, span: slice) -> None:
    """Measured and simulated signal of one channel over time, and the residual with the noise band below it.

    Parameters
    ----------
    comparison : RecordComparison
    channel : str
        Such as ``y.A_zeta``.
    ax, below : Axes
        For the signals and for the residual.
    span : slice
        Samples to show.
    """
    names = [c.channel for c in comparison.channels]
    k = names.index(channel)
    row = comparison.channels[k]
    factor, unit = (1e6, "um") if row.unit == "m" else (1e3, "mA")
    t = comparison.record.t[span] * 1e3
    residual = factor * comparison.residual[span, k]
    simulated = factor * (comparison.simulated[:, k] - comparison.simulated[:, k].mean())[span]
    ax.plot(t, simulated + residual, color=MEASURED, lw=2.2, alpha=0.7, label="measured")
    ax.plot(t, simulated, color=SIMULATED, lw=1.0, label="simulated")
    title = f"{channel}   fit {row.fit_percent:.1f} %"
    if np.isfinite(row.noise_ceiling_percent):
        title += f" of {row.noise_ceiling_percent:.1f} %"
        band = 2.0 * factor * row.noise_rms
        below.axhspan(-band, band, color=BAND, alpha=0.6, lw=0, label="noise, 2 sigma")
    ax.set_title(title, fontsize=9, loc="left")
    ax.set_ylabel(f"{channel.split('.')[0]} [{unit}]", fontsize=8)
    below.plot(t, residual, color="black", lw=0.7, label="residual")
    below.set_ylabel(f"[{unit}]", fontsize=8)
    ax.tick_params(labelbottom=False, labelsize=7)
    below.tick_params(labelsize=7)
    for axes in (ax, below):
        axes.set_xlim(t[0], t[-1])
        axes.grid(True, lw=0.3, alpha=0.6)


def plot_comparison(comparison: RecordComparison, *, milliseconds: float = 40.0) -> Figure:
    """Draw all channels of a record: displacements to the left, currents to the right, an axis a row.

    Parameters
    ----------
    comparison : RecordComparison
    milliseconds : float
        Length of the part that is shown; it begins with the second period, where the transient has gone.

    Returns
    -------
    Figure
    """
    record = comparison.record
    signals = ("y", "i_c") if record.i_c is not None else ("y",)
    figure = Figure(figsize=(6.2 * len(signals), 2.4 * len(record.axes) + 0.8), layout="constrained")
    first = min(record.period or 0, record.samples // 2)
    span = slice(first, min(record.samples, first + max(2, round(milliseconds * 1e-3 * record.sample_rate))))
    grid = figure.add_gridspec(2 * len(record.axes), len(signals), height_ratios=[3, 1.3] * len(record.axes))
    for i, axis in enumerate(record.axes):
        for j, signal in enumerate(signals):
            ax = figure.add_subplot(grid[2 * i, j])
            below = figure.add_subplot(grid[2 * i + 1, j], sharex=ax)
            plot_channel(comparison, f"{signal}.{axis}", ax, below, span=span)
            if i == len(record.axes) - 1:
                below.set_xlabel("time [ms]", fontsize=8)
            if i == j == 0:
                handles = [*ax.get_legend_handles_labels()[0], *below.get_legend_handles_labels()[0]]
                figure.legend(handles=handles, loc="outside upper right", ncols=4, fontsize=8, frameon=False)
    title = f"{record.name}: measured against simulated"
    if np.isfinite(comparison.misfit):
        title += f"   (misfit {comparison.misfit:.2f}, 1 when the model is right)"
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    return figure


def check_format(path: Path | None) -> None:
    """Refuse a picture's file name whose suffix is none of .png, .pdf, .svg, before any work is done.

    Raises
    ------
    InputError
    """
    if path is not None and path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: the suffix is {path.suffix or 'missing'}; expected one of {', '.join(FORMATS)}")


def save_comparison(comparison: Comparison, path: str | Path) -> list[Path]:
    """Write one picture per record; several records get numbered names.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    path = Path(path)
    check_format(path)
    many = len(comparison.records) > 1
    written = []
    for i, record in enumerate(comparison.records, start=1):
        target = path.with_stem(f"{path.stem}_{i}") if many else path
        plot_comparison(record).savefig(target, dpi=130)
        written.append(target)
    return written
