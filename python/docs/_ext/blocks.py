"""The code blocks of a page, run from top to bottom in one folder and one namespace, as a reader would run them."""

from __future__ import annotations

import io
import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ambid.cli import main

BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A piece of code on a page.

    Attributes
    ----------
    language : {"python", "sh"}
    code : str
    end : int
        Where it ends in the text of the page.
    """

    language: str
    code: str
    end: int

    @property
    def commands(self) -> list[list[str]]:
        """The words of each line of a shell block."""
        lines = self.code.replace("\\\n", " ").splitlines()
        return [words for line in lines if (words := shlex.split(line, comments=True))]


def blocks(text: str) -> list[Block]:
    """The blocks of a page in Markdown that are to be run."""
    return [Block(found[1], found[2], found.end()) for found in BLOCK.finditer(text)]


def run(text: str, page: str, folder: Path) -> Iterator[tuple[Block, str]]:
    """Run the blocks of a page.

    Parameters
    ----------
    text : str
        Of the page, Markdown.
    page : str
        Its name, for messages.
    folder : Path
        Where they run; what they write stays there.

    Yields
    ------
    Block, str
        Each block, and what it printed.

    Raises
    ------
    RuntimeError
        If a block fails.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks(text):
        printed = io.StringIO()
        try:
            with chdir(folder), redirect_stdout(printed):
                if block.language == "python":
                    exec(compile(block.code, page, "exec"), names)
                else:
                    for words in block.commands:
                        _command(words)
        except Exception as error:
            raise RuntimeError(f"{page}: {type(error).__name__}: {error}\nin the block\n{block.code}") from error
        yield block, printed.getvalue()


def _command(words: list[str]) -> None:
    """Run one `ambid ...`, as a shell would."""
    if words[0] != "ambid":
        raise ValueError(f"{words[0]}: a page's shell blocks hold commands of ambid alone")
    matches = [sorted(map(str, Path().glob(word))) if "*" in word else [] for word in words]
    arguments = [part for word, found in zip(words, matches, strict=True) for part in found or [word]]
    before, sys.argv = sys.argv, arguments
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            main()
    except SystemExit as end:
        if end.code:
            raise RuntimeError(f"{shlex.join(words)} ended with {end.code}: {said.getvalue()}") from None
    finally:
        sys.argv = before
