"""Tables of text: quotes, comments and units above them, decimal commas, and columns that hold no numbers."""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.record.content import Content, NotNumbers, require_columns, require_names

DECIMAL_COMMAS = Kind("decimal_commas", "note", "decimal commas were read as decimal points")
EMPTY_LAST_COLUMN = Kind(
    "empty_last_column", "note", "every row ends with a separator: the empty last column is left out"
)
UNITS_NOT_READ = Kind(
    "units_not_read", "note", "the line of units ({units}) is not read: values are in s, m, A, or as a map says"
)
COMMENT_LINES = Kind("comment_lines", "note", "comment lines above the header are skipped: {count}")
NOT_UTF_8 = Kind("read_as_windows_1252", "note", "the text is not in UTF-8, and was read as Windows-1252")
WHITE_SPACE = Kind(
    "separated_by_white_space", "note", "no comma, semicolon or tab in the header: white space separates the cells"
)

LONGEST_LINE = 1 << 20
"""Characters of a header: 100 for each of as many columns as are allowed."""
COMMENTS = ("#", "%", "!", "sep=")
"""What lines above the header begin with that are none of the table; the last one is of spreadsheets."""
WINDOWS = "cp1252"


@dataclass
class _Sheet:
    """Names of the columns, the lines below them, and what was noticed.

    The separator is None where white space parts the cells; `ends_empty` where rows end with a separator.
    """

    names: list[str]
    has_names: bool
    separator: str | None
    ends_empty: bool = False
    lines: Iterator[str] = field(default_factory=lambda: iter(()))
    findings: list[Finding] = field(default_factory=list)
    marks: set[str] = field(default_factory=set)
    units: list[str] = field(default_factory=list)

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

    @property
    def all_findings(self) -> list[Finding]:
        """Also those that are known when all rows are read."""
        return [
            *self.findings,
            *([DECIMAL_COMMAS()] if "," in self.marks else []),
            *([EMPTY_LAST_COLUMN()] if self.ends_empty else []),
        ]

    def pointed(self, cell: str) -> str:
        """A number with a decimal point for a comma; its mark is kept."""
        if "." in cell:
            self.marks.add(".")
        if "," not in cell:
            return cell
        self.marks.add(",")
        return cell.replace(",", ".")

    def with_points(self, lines: Iterable[str]) -> Iterator[str]:
        """The lines with decimal points for commas, where commas part no cells; both marks of a file are kept."""
        for line in lines:
            has_point, has_comma = "." in line, self.separator != "," and "," in line
            self.marks.update("." * has_point + "," * has_comma)
            yield line.replace(",", ".") if has_comma and not has_point else line


def read_table(path: Path) -> Content:
    """Read a table with a header; commas, semicolons, tabs or white space separate the cells, names may be in quotes.

    A column without a name whose cells are all empty, as rows that end with a separator make it, is left out. Lines
    above the header that begin with ``#``, ``%`` or ``!`` are passed over, and so is a line of units below it; decimal
    commas are read where no commas part the cells. Findings say so. A column with a cell that is no number, such as the
    time of day, is a `NotNumbers`.

    Raises
    ------
    RecordError
        For a missing header, a duplicated column, a header without rows, or a row of another length (with its number,
        counted from 1).
    """
    with _opened(path) as sheet:
        try:
            first = next(sheet.lines)
            # row by row: the text of a long record is several times as large as its numbers
            rows = sheet.with_points(chain([first], sheet.lines))
            table = np.loadtxt(rows, delimiter=sheet.separator, comments=None, ndmin=2, quotechar='"')
            is_whole = table.shape[1] == len(sheet.names)
        except ValueError as error:
            if isinstance(error, UnicodeDecodeError):
                raise
            is_whole = False
    columns: dict[str, FloatArray | NotNumbers]
    if is_whole:
        columns = dict(zip(sheet.names, table.T, strict=True))
    else:
        sheet, columns = _without_words(path)
    if sheet.marks == {".", ","}:
        raise RecordError(f"{path}: decimal commas and decimal points in one file; write all numbers with points")
    return Content(columns, is_table=True, has_names=sheet.has_names, findings=sheet.all_findings)


@dataclass(frozen=True)
class Cells:
    """A table as text: names of the columns, their units where a line below the header states them, and rows.

    Numbers have decimal points; a cell is empty where it says nothing.
    """

    names: list[str]
    units: list[str]
    rows: list[list[str]]
    findings: list[Finding]


def header_of(path: Path) -> list[str]:
    """The names of the columns; none where the file is no such table."""
    with suppress(RecordError), path.open(encoding=_encoding(path), errors="replace") as file:
        sheet = _sheet(path, file)
        return sheet.names if sheet.has_names else []
    return []


def read_cells(path: Path) -> Cells:
    """Read a table as text.

    Raises
    ------
    RecordError
        As `read_table`, and for numbers where names are expected.
    """
    with _opened(path) as sheet:
        require_names(path, sheet.has_names)
        rows = list(_rows(path, sheet))
        words = {k for row in rows for k, own in enumerate(row) if own and not _is_number(own.replace(",", "."))}
        cells = [[cell if k in words else sheet.pointed(cell) for k, cell in enumerate(row)] for row in rows]
        return Cells(sheet.names, sheet.units or [""] * len(sheet.names), cells, sheet.all_findings)


@contextmanager
def _opened(path: Path) -> Iterator[_Sheet]:
    """What a file begins with, rows to be read on from there; at least one."""
    try:
        encoding = _encoding(path)
        with path.open(encoding=encoding) as file:
            sheet = _sheet(path, file)
            sheet.findings += [NOT_UTF_8()] if encoding == WINDOWS else []
            twice = [name for name, count in Counter(sheet.names).items() if count > 1]
            if twice:
                count = sheet.names.count(twice[0])
                raise RecordError(f"{path}: column {twice[0]!r} is there {count} times; keep one")
            first = next(sheet.lines, None)
            if first is None:
                raise RecordError(f"{path}: a header without rows; record it again")
            sheet.lines = chain([first], sheet.lines)
            yield sheet
    except UnicodeDecodeError:
        raise RecordError(f"{path}: not a text file; give comma-separated text in UTF-8") from None


def _encoding(path: Path) -> str:
    """UTF-8, or UTF-16 with its mark, or, of text that is neither, that of Windows."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16" if 4 * head.count(0) >= len(head) else "utf-8-sig"  # numbers have a zero in every character
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        is_text = all(byte >= 0x20 or byte in b"\t\r\n" for byte in head)
        return WINDOWS if is_text else "utf-8-sig"
    return "utf-8-sig"


def _without_words(path: Path) -> tuple[_Sheet, dict[str, FloatArray | NotNumbers]]:
    """Read a table some of whose cells are no numbers: their columns have no values."""
    with suppress(ValueError):  # most have them in every row, so that the first one shows them
        return _without(path, _words(path, 1))
    try:
        return _without(path, _words(path, None))
    except ValueError as error:
        raise RecordError(f"{path}: {error}") from None


def _words(path: Path, rows: int | None) -> dict[int, tuple[int, str]]:
    """Columns with a cell that is no number in the first rows, with the first such row and the cell."""
    wrong: dict[int, tuple[int, str]] = {}
    with _opened(path) as sheet:
        for row, cells in enumerate(islice(_rows(path, sheet), rows), start=1):
            for k, cell in enumerate(cells):
                if k not in wrong and not _is_number(cell.replace(",", ".")):
                    wrong[k] = row, cell
    return wrong


def _without(path: Path, wrong: dict[int, tuple[int, str]]) -> tuple[_Sheet, dict[str, FloatArray | NotNumbers]]:
    """Read the other columns of a table; ValueError where one has a cell that is no number."""
    with _opened(path) as sheet:
        kept = [k for k in range(len(sheet.names)) if k not in wrong]
        lines = (" ".join(sheet.pointed(cells[k] or "?") for k in kept) for cells in _rows(path, sheet))
        table = np.loadtxt(lines, comments=None, ndmin=2) if kept else np.empty((sum(1 for _ in lines), 0))
    columns = {k: NotNumbers((len(table),), *wrong[k]) for k in wrong} | dict(zip(kept, table.T, strict=True))
    return sheet, {name: columns[k] for k, name in enumerate(sheet.names)}


def _sheet(path: Path, file: TextIO) -> _Sheet:
    """What a file begins with; its rows are read on from there."""
    comments, head = [], file.readline(LONGEST_LINE)
    while head and len(head) < LONGEST_LINE and (not head.strip() or head.startswith(COMMENTS)):
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
    below = next(lines, None)
    if _is_row(head, below, separator):
        lines = chain([head], [] if below is None else [below], lines)
        above = _names(comments[-1], separator) if comments else []
        sheet.has_names = len(above) == len(cells)
        sheet.names = above if sheet.has_names else [str(k + 1) for k in range(len(cells))]
        comments = comments[:-1] if sheet.has_names else comments
    elif below is not None:
        units = _split(below.rstrip("\r\n"), separator)[: len(cells)]
        if len(units) == len(cells) > 1 and any(units) and all(_is_unit(unit) for unit in units):
            sheet.units = units
            sheet.findings.append(UNITS_NOT_READ(units=[unit for unit in units if unit]))
        else:
            lines = chain([below], lines)
    if comments:
        sheet.findings.append(COMMENT_LINES(count=len(comments)))
    if separator is None:
        sheet.findings.append(WHITE_SPACE())
    sheet.lines = sheet.trimmed(lines)
    return sheet


def _split(line: str, separator: str | None) -> list[str]:
    """Cells of a line without quotes and the white space around them."""
    parted = next(csv.reader([line], delimiter=separator), []) if '"' in line and separator else line.split(separator)
    return [cell.strip().strip('"') for cell in parted]


def _names(line: str, separator: str | None) -> list[str]:
    """Cells of a header, without an empty last one; what has no name is called by its place."""
    cells = _split(line, separator)
    cells = cells[:-1] if len(cells) > 1 and not cells[-1] else cells
    return [cell or f"column {k}" for k, cell in enumerate(cells, start=1)]


def _has_numbers(line: str, separator: str | None) -> list[bool]:
    return [_is_number(cell.replace(",", ".")) for cell in _split(line, separator)]


def _rows(path: Path, sheet: _Sheet) -> Iterator[list[str]]:
    """Cells of every row, without quotes; refuses one of another length than the header."""
    for row, line in enumerate(sheet.lines, start=1):
        cells = _split(line.rstrip("\n"), sheet.separator)
        if len(cells) == len(sheet.names):
            yield cells
            continue
        problem = f"row {row} has {len(cells)} cells, the header {len(sheet.names)}"
        if sheet.separator == "," and len(cells) > len(sheet.names) and "." not in line and _all_whole(cells):
            problem += (
                ", and no number has a decimal point: decimal commas between commas cannot be distinguished from "
                "separators; export with decimal points, or with semicolons or tabs between the cells"
            )
        elif row == 1 and len(cells) == len(sheet.names) + 1 and sheet.separator is not None:
            problem += f": the last one is {cells[-1]!r}; name its column in the header, or remove it"
        else:
            problem += "; complete or remove the row"
        raise RecordError(f"{path}: {problem}")


def _is_row(head: str, below: str | None, separator: str | None) -> bool:
    """Whether a first line is no header: it holds numbers, one a decimal fraction, where the line below does."""
    has_numbers = _has_numbers(head, separator)
    if all(has_numbers) or below is None or not any(has_numbers):
        return all(has_numbers)
    fractions = [
        cell for cell in _split(head, separator) if _is_number(cell.replace(",", ".")) and not cell.isdecimal()
    ]
    return bool(fractions) and has_numbers == _has_numbers(below, separator)


def _is_unit(cell: str) -> bool:
    """Whether a cell may be of a line of units, where those without one are empty."""
    return (
        not cell
        or cell == "-"
        or (re.fullmatch(r"[\[(]?[A-Za-zµμΩ°%][\w/*^·.µμΩ° -]{0,11}[\])]?", cell) is not None and not _is_number(cell))
    )


def _all_whole(cells: Iterable[str]) -> bool:
    """Whether the cells are what decimal commas leave of numbers: whole ones, some with an exponent."""
    return all(re.fullmatch(r"[+-]?\d+([eE][+-]?\d+)?", cell.strip()) for cell in cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
