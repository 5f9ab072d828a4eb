"""Tables of text: quotes, comments and units above them, decimal commas, and the first cell that is no number."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TextIO

import numpy as np

from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.record.content import Content, require_columns

__all__ = ["read_table"]

DECIMAL_COMMAS = Kind("decimal_commas", "note", "decimal commas were read as decimal points")
EMPTY_LAST_COLUMN = Kind(
    "empty_last_column", "note", "every row ends with a separator: the empty last column is left out"
)
UNITS_NOT_READ = Kind(
    "units_not_read", "note", "the line of units ({units}) is not read: values are in s, m, A, or as a map says"
)
COMMENT_LINES = Kind("comment_lines", "note", "comment lines above the header are skipped: {count}")
WHITE_SPACE = Kind(
    "separated_by_white_space", "note", "no comma, semicolon or tab in the header: white space separates the cells"
)

LONGEST_LINE = 1 << 20
"""Characters of a header: 100 for each of as many columns as are allowed."""
UNIT = re.compile(r"[\[(]?[A-Za-zµμΩ°%][\w/*^·.µμΩ° -]{0,11}[\])]?")
"""What a cell of a line of units looks like."""


@dataclass
class _Sheet:
    """Names of the columns, lines of numbers below them with decimal points, and what was noticed.

    The separator is None where white space parts the cells; `ends_empty` tells of rows that end with a separator.
    """

    names: list[str]
    has_names: bool
    separator: str | None
    ends_empty: bool = False
    rows: Iterator[str] = field(default_factory=lambda: iter(()))
    findings: list[Finding] = field(default_factory=list)
    marks: set[str] = field(default_factory=set)

    def trimmed(self, lines: Iterator[str]) -> Iterator[str]:
        """The lines without the separator that each ends with, where the first one has an empty last cell too many."""
        first = next(lines, None)
        if first is None:
            return
        self.ends_empty = self._ends_empty(first)
        for line in chain([first], lines):
            yield line.rstrip(" \r\n")[:-1] + "\n" if self.ends_empty and self._ends_empty(line) else line

    def _ends_empty(self, line: str) -> bool:
        own = line.rstrip(" \r\n")
        return (
            self.separator is not None and own.endswith(self.separator) and own.count(self.separator) == len(self.names)
        )

    def with_points(self, lines: Iterable[str]) -> Iterator[str]:
        """The lines with decimal points for commas, where commas part no cells; both marks of a file are kept."""
        for line in lines:
            has_point, has_comma = "." in line, self.separator != "," and "," in line
            self.marks.update("." * has_point + "," * has_comma)
            yield line.replace(",", ".") if has_comma and not has_point else line


def read_table(path: Path) -> Content:
    """Read a table with a header; commas, semicolons, tabs or white space separate the cells, names may be in quotes.

    A column without a name whose cells are all empty, as rows that end with a separator make it, is left out. Lines
    above the header that begin with ``#`` are passed over, and so is a line of units below it; decimal commas are read
    where no commas part the cells. Findings say so.

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
            rows = chain([first], sheet.rows)
            table = np.loadtxt(rows, delimiter=sheet.separator, comments=None, ndmin=2, quotechar='"')
    except UnicodeDecodeError:
        raise RecordError(f"{path}: not a text file; give comma-separated text in UTF-8") from None
    except ValueError as error:
        raise RecordError(f"{path}: {_first_bad_cell(path) or error}") from None
    if table.shape[1] != len(names):
        unequal = f"{len(names)} names in the header, {table.shape[1]} columns below; make them equal"
        raise RecordError(f"{path}: {_first_bad_cell(path) or unequal}")
    if sheet.marks == {".", ","}:
        raise RecordError(f"{path}: decimal commas and decimal points in one file; write all numbers with points")
    findings = sheet.findings + [DECIMAL_COMMAS()] * ("," in sheet.marks) + [EMPTY_LAST_COLUMN()] * sheet.ends_empty
    return Content(dict(zip(names, table.T, strict=True)), is_table=True, has_names=sheet.has_names, findings=findings)


def _sheet(path: Path, file: TextIO) -> _Sheet:
    """What a file begins with; its rows are read on from there."""
    comments, head = [], file.readline(LONGEST_LINE)
    while head and len(head) < LONGEST_LINE and (not head.strip() or head.startswith("#")):
        comments += [head[1:].strip()] if head.strip() else []
        head = file.readline(LONGEST_LINE)
    if len(head) == LONGEST_LINE:
        raise RecordError(f"{path}: a first line of more than {LONGEST_LINE} characters; give a row a sample")
    separator: str | None = max(",;\t", key=head.count)
    if head.count(separator or "") == 0 and len(head.split()) > 1:
        separator = None
    cells = _names(head, separator)
    require_columns(path, len(cells))
    sheet = _Sheet(cells, True, separator)
    lines: Iterator[str] = filter(str.strip, file)
    if all(_is_number(cell.replace(",", ".")) for cell in cells):
        lines = chain([head], lines)
        above = _names(comments[-1], separator) if comments else []
        sheet.has_names = len(above) == len(cells)
        sheet.names = above if sheet.has_names else [str(k + 1) for k in range(len(cells))]
        comments = comments[:-1] if sheet.has_names else comments
    elif (below := next(lines, None)) is not None:
        units = _names(below, separator)
        if len(units) == len(cells) > 1 and all(UNIT.fullmatch(unit) and not _is_number(unit) for unit in units):
            sheet.findings.append(UNITS_NOT_READ(units=units))
        else:
            lines = chain([below], lines)
    if comments:
        sheet.findings.append(COMMENT_LINES(count=len(comments)))
    if separator is None:
        sheet.findings.append(WHITE_SPACE())
    sheet.rows = sheet.with_points(sheet.trimmed(lines))
    return sheet


def _names(line: str, separator: str | None) -> list[str]:
    """Cells of a line without quotes and the white space around them; without an empty last one."""
    parted = next(csv.reader([line], delimiter=separator), []) if '"' in line and separator else line.split(separator)
    cells = [cell.strip().strip('"') for cell in parted]
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def _first_bad_cell(path: Path) -> str | None:
    """Name the first cell that is no number, or the first row of a wrong length."""
    with path.open(encoding="utf-8-sig") as file:
        sheet = _sheet(path, file)
        for row, line in enumerate(sheet.rows, start=1):
            cells = line.rstrip("\n").split(sheet.separator)
            told = f"row {row} has {len(cells)} cells, the header {len(sheet.names)}"
            if sheet.separator == "," and len(cells) > len(sheet.names) and "." not in line and _all_whole(cells):
                return (
                    f"{told}, and no number has a decimal point: decimal commas between commas cannot be told from "
                    "separators; export with decimal points, or with semicolons or tabs between the cells"
                )
            if row == 1 and len(cells) == len(sheet.names) + 1 and sheet.separator is not None:
                return f"{told}: the last one is {cells[-1].strip()!r}; name its column in the header, or remove it"
            if len(cells) != len(sheet.names):
                return f"{told}; complete or remove the row"
            for k, (name, cell) in enumerate(zip(sheet.names, cells, strict=True), start=1):
                if not _is_number(cell.strip().strip('"')):
                    of = name or f"column {k}, without a name"
                    return f"{of}, row {row}: {cell.strip()!r} is not a number; correct the cell"
    return None


def _all_whole(cells: Iterable[str]) -> bool:
    """Whether the cells are what decimal commas leave of numbers: whole ones, some with an exponent."""
    return all(re.fullmatch(r"[+-]?\d+([eE][+-]?\d+)?", cell.strip()) for cell in cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
