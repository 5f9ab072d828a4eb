"""Tables of text: comments and units above them, decimal commas, and the first cell that is no number."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TextIO

import numpy as np

from ambid.errors import RecordError
from ambid.record.content import Content, require_columns

__all__ = ["read_table"]

LONGEST_LINE = 1 << 20
"""Characters of a header: 100 for each of as many columns as are allowed."""
UNIT = re.compile(r"[\[(]?[A-Za-zµμΩ°%][\w/*^·.µμΩ° -]{0,11}[\])]?")
"""What a cell of a line of units looks like."""


@dataclass
class _Sheet:
    """Names of the columns, lines of numbers below them with decimal points, and what was noticed."""

    names: list[str]
    has_names: bool
    separator: str
    rows: Iterator[str] = field(default_factory=lambda: iter(()))
    notes: list[str] = field(default_factory=list)
    marks: set[str] = field(default_factory=set)

    def with_points(self, lines: Iterable[str]) -> Iterator[str]:
        """The lines with decimal points for commas, where commas part no cells; both marks of a file are kept."""
        for line in lines:
            has_point, has_comma = "." in line, self.separator != "," and "," in line
            self.marks.update("." * has_point + "," * has_comma)
            yield line.replace(",", ".") if has_comma and not has_point else line


def read_table(path: Path) -> Content:
    """Read a table with a header; commas, semicolons or tabs separate the cells.

    Lines above it that begin with ``#`` are passed over, and so is a line of units below it; decimal commas are read
    where semicolons or tabs part the cells. Notes say so.

    Raises
    ------
    RecordError
        For a missing header, a duplicated column, a header without rows, or a cell that is not a number (with its row,
        counted from 1).
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            sheet = _sheet(path, file)
            names = sheet.names
            twice = [name for name, count in Counter(names).items() if count > 1]
            if twice:
                raise RecordError(f"{path}: column {twice[0]!r} is there {Counter(names)[twice[0]]} times; keep one")
            first = next(sheet.rows, None)
            if first is None:
                raise RecordError(f"{path}: a header without rows; record it again")
            # row by row: the text of a long record is several times as large as its numbers
            table = np.loadtxt(chain([first], sheet.rows), delimiter=sheet.separator, comments=None, ndmin=2)
    except UnicodeDecodeError:
        raise RecordError(f"{path}: not a text file; give comma-separated text in UTF-8") from None
    except ValueError as error:
        raise RecordError(f"{path}: {_first_bad_cell(path) or error}") from None
    if table.shape[1] != len(names):
        raise RecordError(f"{path}: {len(names)} names in the header, {table.shape[1]} columns below; make them equal")
    if sheet.marks == {".", ","}:
        raise RecordError(f"{path}: decimal commas and decimal points in one file; write all numbers with points")
    notes = sheet.notes + ["decimal commas were read as decimal points"] * ("," in sheet.marks)
    return Content(dict(zip(names, table.T, strict=True)), is_table=True, has_names=sheet.has_names, notes=notes)


def _sheet(path: Path, file: TextIO) -> _Sheet:
    """What a file begins with; its rows are read on from there."""
    comments, head = [], file.readline(LONGEST_LINE)
    while head and len(head) < LONGEST_LINE and (not head.strip() or head.startswith("#")):
        comments += [head[1:].strip()] if head.strip() else []
        head = file.readline(LONGEST_LINE)
    if len(head) == LONGEST_LINE:
        raise RecordError(f"{path}: a first line of more than {LONGEST_LINE} characters; give a row a sample")
    separator = max(",;\t", key=head.count)
    cells = [cell.strip() for cell in head.split(separator)]
    require_columns(path, len(cells))
    sheet = _Sheet(cells, True, separator)
    lines: Iterator[str] = filter(str.strip, file)
    if all(_is_number(cell.replace(",", ".")) for cell in cells):
        lines = chain([head], lines)
        above = [cell.strip() for cell in comments[-1].split(separator)] if comments else []
        sheet.has_names = len(above) == len(cells)
        sheet.names = above if sheet.has_names else [str(k + 1) for k in range(len(cells))]
        comments = comments[:-1] if sheet.has_names else comments
    elif (below := next(lines, None)) is not None:
        units = [cell.strip() for cell in below.split(separator)]
        if len(units) == len(cells) > 1 and all(UNIT.fullmatch(unit) and not _is_number(unit) for unit in units):
            told = f"the line of units ({', '.join(units)}) is not read: values are in s, m, A, or as a map says"
            sheet.notes.append(told)
        else:
            lines = chain([below], lines)
    if comments:
        sheet.notes.append(f"comment lines above the header are passed over: {len(comments)}")
    sheet.rows = sheet.with_points(lines)
    return sheet


def _first_bad_cell(path: Path) -> str | None:
    """Name the first cell that is no number, or the first row of a wrong length."""
    with path.open(encoding="utf-8-sig") as file:
        sheet = _sheet(path, file)
        for row, line in enumerate(sheet.rows, start=1):
            cells = line.rstrip("\n").split(sheet.separator)
            if len(cells) != len(sheet.names):
                return f"row {row} has {len(cells)} cells, the header {len(sheet.names)}; complete or remove the row"
            for name, cell in zip(sheet.names, cells, strict=True):
                if not _is_number(cell):
                    return f"{name}, row {row}: {cell.strip()!r} is not a number; correct the cell"
    return None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
