"""What all pictures share: colours, markers, units, sizes, and where they may be written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambid.errors import InputError, printable
from ambid.symbols import in_picture
from ambid.writing import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

MEASURED, SIMULATED, BAND, GUIDE = "#a8a8a8", "#a32a00", "#c9dcee", "#555555"
NOTHING = "#ececec"
"""Of cells that say nothing."""
AXIS_COLOURS = ("#1f4e8c", "#c05a00", "#2e7d4f", "#7b4a9e")
AXIS_MARKERS = ("o", "s", "^", "D")
TITLE, LABEL, SMALL = 10, 9, 8
"""Font sizes [pt] of a figure 9 inches wide."""
FORMATS = (".png", ".pdf", ".svg")
UNITS = {"m": (1e6, "µm"), "A": (1e3, "mA"), "m/s": (1e3, "mm/s"), "T": (1e3, "mT"), "m/s^2": (1.0, "m/s²")}


def shown_in(unit: str, largest: float = 0.0) -> tuple[float, str]:
    """Factor and name of the unit in which an SI unit is drawn; currents of 1 A and more in amperes."""
    return (1.0, unit) if unit == "A" and largest >= 1.0 else UNITS.get(unit, (1.0, unit))


def misfit_text(value: float) -> str:
    """A misfit J/dof with as many digits as matter."""
    return f"{value:.2f}" if value < 9.995 else f"{value:.1f}" if value < 99.95 else f"{value:.0f}"


def short_number(value: float) -> str:
    """Two or three digits that fit into a cell."""
    if value >= 9.5e5:
        return f"{value / 1e6:.2g} M"
    if value >= 9950.0:
        return f"{value / 1e3:.0f} k"
    return f"{value:.0f}" if value >= 99.5 else f"{value:.2g}" if value >= 9.95 else f"{value:.1f}"


def plain_log(axis: Axis) -> None:
    """A logarithmic scale with plain numbers at 1, 2 and 5, or at the powers of ten where it is long."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 200.0 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def new_figure(width: float, height: float) -> Figure:
    """A figure of its own, not pyplot's, that sets symbols in its texts; `width` and `height` in inches."""
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter

    class Literal(Figure):
        """Symbols have subscripts; in names of files a ``$`` begins no formula, and a control character no damage."""

        def draw(self, renderer: Any) -> None:
            axes = [axis for ax in self.axes for axis in (ax.xaxis, ax.yaxis)]
            logarithmic = [axis for axis in axes if isinstance(axis.get_major_formatter(), LogFormatter)]
            powers = {text for axis in logarithmic for text in axis.get_ticklabels(which="both")}
            for text in set(self.findobj(Text)) - powers:
                # at the moment it is drawn: labels of ticks are written anew with every drawing
                text._preprocess_math = _set_line  # type: ignore[attr-defined]
            super().draw(renderer)

    return Literal(figsize=(width, height), layout="constrained")


def _set_line(line: str) -> tuple[str, bool]:
    """A line as it is drawn, and whether it holds formulas."""
    return in_picture(printable(line))


def dress(ax: Axes, *, title: str = "", x: str = "", y: str = "", grid: str | None = "both") -> None:
    """Give axes their title, labels, font sizes and a light grid behind the data."""
    if title:
        ax.set_title(title, fontsize=TITLE, loc="left")
    ax.set_xlabel(x, fontsize=LABEL)
    ax.set_ylabel(y, fontsize=LABEL)
    ax.tick_params(labelsize=SMALL)
    ax.set_axisbelow(True)
    if grid is not None:
        style: dict[str, Any] = {"lw": 0.4, "color": "#cccccc"}
        ax.grid(True, axis=grid, **style)  # type: ignore[arg-type]
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def head(figure: Figure, text: str) -> None:
    """Give a figure of several panels its title."""
    figure.suptitle(text, fontsize=TITLE, x=0.01, ha="left")


def legend(figure: Any, *panels: Axes, across: int = 4) -> None:
    """One legend for several panels, below the figure, with so many labels beside each other."""
    handles = [handle for panel in panels for handle in panel.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=across, fontsize=SMALL, frameon=False)


def check_format(path: Path | None) -> None:
    """Refuse a picture's file name whose suffix is none of .png, .pdf, .svg, before any work is done.

    Raises
    ------
    InputError
    """
    if path is not None and path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: the suffix is {path.suffix or 'missing'}; expected one of {', '.join(FORMATS)}")


def save_drawn(path: str | Path, draw: Callable[[], Any]) -> Path:
    """Write the picture that is drawn into these axes; the format is checked before.

    Raises
    ------
    InputError
        If the suffix is none of .png, .pdf, .svg.
    """
    path = Path(path)
    check_format(path)
    save_figure(draw().figure, path)
    return path


def save_figure(figure: Figure, path: Path, dpi: int = 130) -> None:
    """Write a figure in the format that the suffix names.

    Raises
    ------
    InputError, OutputError
        As `ambid.writing.whole_file`.
    """
    with whole_file(path) as stream:
        figure.savefig(stream, format=path.suffix[1:].lower(), dpi=dpi)
