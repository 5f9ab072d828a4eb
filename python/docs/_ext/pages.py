"""What is filled into the pages when they are read: generated tables, values of constants, and what blocks print.

In the text of a page stand

- ``% generated: NAME``, for what the module NAME of this folder generates;
- ``{{package.NAME}}``, for the value of a constant, such as ``{{diagnosis.ALPHA}}``;
- ``% output`` below a block of code, for what it prints (``% output 12`` for its first 12 lines);
- ``% printed: PATTERN``, where the words around take for granted that the last block above it printed that;
- ``% measured: calibration/nulls.md``, for a table or picture that a benchmark has left in that file, if it has;
- ``](drawn/fit.png)``, for a picture that a block of the page, or what was generated for it, has drawn.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from blocks import blocks, run
from thresholds import value_text

if TYPE_CHECKING:  # what finds the places on a page is tested where there is no Sphinx
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

GENERATED = re.compile(r"^% generated: (\w+)$", re.MULTILINE)
CONSTANT = re.compile(r"\{\{(\w+)\.(\w+)\}\}")
MEASURED = re.compile(r"^% measured: (\S+)$", re.MULTILINE)
NOT_YET = "*Not measured with this version yet.*"
PRINTED = re.compile(r"^% printed: (.+)$", re.MULTILINE)
OUTPUT = re.compile(r"\n% output ?(\d*)$", re.MULTILINE)


def fill(app: Sphinx, page: str, source: list[str]) -> None:
    """Fill a page that is about to be parsed."""
    drawn = Path(app.outdir).parent / "docs-drawn" / page
    shutil.rmtree(drawn, ignore_errors=True)
    drawn.mkdir(parents=True)
    try:
        text = with_output(source[0], page, drawn)
        text = with_measured(text, Path(app.srcdir))
        text = CONSTANT.sub(lambda found: value_text(found[1], found[2]), text)
        text = GENERATED.sub(lambda found: importlib.import_module(found[1]).generate(drawn), text)
    except (RuntimeError, KeyError) as error:
        from sphinx.util import logging  # not at the top: the tests of pages do without Sphinx

        logging.getLogger(__name__).warning("%s", error, location=page)
        return
    source[0] = text.replace("](drawn/", f"]({os.path.relpath(drawn, app.srcdir)}/")


def with_output(text: str, page: str, folder: Path) -> str:
    """Run the blocks of a page, and put what they print where the page asks for it.

    Raises
    ------
    RuntimeError
        If a block fails, or no longer prints what the page takes for granted.
    """
    parts, done = [], 0
    ends = [block.end for block in blocks(text)] + [len(text)]
    for k, (block, printed) in enumerate(run(text, page, folder)):
        for taken in PRINTED.findall(text, block.end, ends[k + 1]):
            if not re.search(taken, printed, re.DOTALL | re.MULTILINE):
                raise RuntimeError(f"{page}: expected {taken!r}, and printed was:\n{printed}")
        parts.append(text[done : block.end])
        done = block.end
        if asked := OUTPUT.match(text, done):
            lines = printed.rstrip().splitlines()
            most = int(asked[1] or len(lines))
            shown = lines[:most] + (["..."] if len(lines) > most else [])
            parts.append("\n\n```text\n" + "\n".join(shown) + "\n```\n")
            done = asked.end()
    return "".join([*parts, text[done:]])


def with_measured(text: str, folder: Path) -> str:
    """Put tables and pictures of benchmarks where the page asks for them; where there is no table, say so."""

    def found(asked: re.Match[str]) -> str:
        path = folder / asked[1]
        is_table = path.suffix == ".md"
        if not path.exists():
            return NOT_YET if is_table else ""
        title = path.stem.replace("_", " ").capitalize()
        return path.read_text(encoding="utf-8").strip() if is_table else f"![{title}]({asked[1]})"

    return MEASURED.sub(found, text)


def _always(app: Sphinx, env: BuildEnvironment, added: set[str], changed: set[str], removed: set[str]) -> Iterable[str]:
    """Pages that are filled follow the package, not their own file alone."""
    return env.found_docs


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill every page as it is read."""
    app.connect("source-read", fill)
    app.connect("env-get-outdated", _always)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
