"""Tables of texts, as a campaign prints and publishes them: on a terminal, as .csv, for LaTeX."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ambid.errors import InputError
from ambid.symbols import in_latex
from ambid.writing import whole_file

NAMES = ("K_i", "K_s", "tau_e")
SUFFIXES = (".csv", ".tex")
FIRST = "folder"
"""What every table has in its first column, and no record."""


@dataclass(frozen=True)
class Table:
    """A table of texts.

    Attributes
    ----------
    name : str
        What its file is called after.
    title : str
    heading : tuple of str
    rows : tuple of tuple of str
    """

    name: str
    title: str
    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def lines(self) -> list[str]:
        """As text; columns are as wide as they need to be."""
        widths = [max(map(len, column)) for column in zip(self.heading, *self.rows, strict=True)]
        text = [
            "  ".join(f"{cell:>{width}s}" for cell, width in zip(row, widths, strict=True))
            for row in (self.heading, *self.rows)
        ]
        return [self.title, text[0], "-" * len(text[0]), *text[1:]]

    def csv(self) -> str:
        """Comma-separated, the heading first."""
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows([self.heading, *self.rows])
        return stream.getvalue()

    def latex(self) -> str:
        """A table with a caption, for a document."""
        rows = [" & ".join(map(in_latex, row)) + r" \\" for row in (self.heading, *self.rows)]
        return "\n".join(
            [
                r"\begin{table}",
                r"\centering",
                rf"\caption{{{in_latex(self.title)}}}",
                rf"\begin{{tabular}}{{{'l' * 2}{'r' * (len(self.heading) - 2)}}}",
                r"\hline",
                rows[0],
                r"\hline",
                *rows[1:],
                r"\hline",
                r"\end{tabular}",
                r"\end{table}",
                "",
            ]
        )


def table_files(path: Path) -> list[Path]:
    """Where `save_tables` writes each of them.

    Raises
    ------
    InputError
        If the suffix is neither .csv nor .tex.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: the suffix is {path.suffix or 'missing'}; expected {' or '.join(SUFFIXES)}")
    return [path.with_stem(f"{path.stem}_{name}") for name in NAMES]


def is_table(path: Path) -> bool:
    """Whether a file that is there may be one that `save_tables` wrote, and not a record."""
    with path.open("rb") as stream:
        return stream.readline(len(FIRST) + 1) == f"{FIRST},".encode()


def save_tables(tables: Sequence[Table], path: str | Path) -> list[Path]:
    """Write tables, a file each, as .csv or for LaTeX.

    Parameters
    ----------
    tables : sequence of Table
    path : str or Path
        Such as ``bench.csv`` for ``bench_K_i.csv``, ``bench_K_s.csv`` and ``bench_tau_e.csv``.

    Raises
    ------
    InputError
        If the suffix is neither .csv nor .tex.
    """
    files = table_files(Path(path))
    for file, table in zip(files, tables, strict=True):
        text = table.csv() if file.suffix.lower() == ".csv" else table.latex()
        with whole_file(file) as stream:
            stream.write(text.encode())
    return files
