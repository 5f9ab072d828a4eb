"""Whether the matrices and lists of a controller fit each other and the axes of a rig."""

from typing import Annotated, Any

from pydantic_core import InitErrorDetails

from ambid.rig.fields import FINITE, problem

__all__ = ["Matrix", "has_shape", "sizes", "wrong_counts"]

Matrix = tuple[tuple[Annotated[float, FINITE], ...], ...]


def wrong_counts(given: dict[str, tuple[Any, ...]], n_axes: int, signals: int = 1) -> list[InitErrorDetails]:
    """Problems of the keys that have neither one entry, nor one per signal, nor one per signal and axis."""
    per = "one per axis" if signals == 1 else f"{signals}, one per signal, or one per signal and axis"
    return [
        problem(f"expected 1 entry for all axes, or {n_axes * signals}, {per}; found {len(value)}.", value, key)
        for key, value in given.items()
        if len(value) not in (1, signals, n_axes * signals)
    ]


def sizes(a: Matrix, b: Matrix, c: Matrix, d: Matrix, signals: int) -> tuple[int, int, int]:
    """States, axes and signals that most of four matrices agree on: one that is wrong does not make others wrong."""
    rows, columns = len(b), _width(c)
    states = rows if rows and rows == columns else len(a)
    axes = len(c) if c and _width(b) == len(c) * signals else len(d)
    return states, axes, signals


def _width(rows: Matrix) -> int | None:
    """Numbers in each row; None where they are not as many."""
    widths = {len(row) for row in rows}
    return widths.pop() if len(widths) == 1 else None


def has_shape(rows: Matrix, shape: tuple[int, int]) -> bool:
    """Whether a matrix has so many rows of so many numbers; without rows or numbers it may be left out."""
    empty = 0 in shape and not any(rows)
    return empty or (len(rows) == shape[0] and all(len(row) == shape[1] for row in rows))
