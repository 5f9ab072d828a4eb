"""Texts that a person reads, held by golden files: `golden.toml` beside the tests that show them.

``pytest --golden=write -n 0 -m ''`` renews them; the change is then read as a diff. Words must be the same; numbers may
differ by what another processor's rounding makes of the printed digits.
"""

import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import isclose
from pathlib import Path

import pytest

from places import TESTS

FILE = "golden.toml"
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
DIGITS = 0.02
"""Relative difference of two printed numbers that may be rounding: most are printed with three digits."""


@dataclass(frozen=True)
class Golden:
    """The golden texts of one test, by its place and a number that counts them."""

    file: Path
    key: str
    folder: str
    session: str
    writes: bool
    count: list[int]

    def holds(self, text: str) -> None:
        """Assert that a text is the golden one."""
        now, key = self._normal(text), f"{self.key} {self.count[0]}".removesuffix(" 0")
        self.count[0] += 1
        if self.writes:
            _write(self.file, key, now)
            return
        known = _read(self.file)
        assert key in known, f"{self.file}: no text under {key!r}; write it with pytest --golden=write -n 0"
        assert NUMBER.sub("#", now) == NUMBER.sub("#", known[key])
        for own, wanted in zip(NUMBER.findall(now), NUMBER.findall(known[key]), strict=True):
            assert own == wanted or isclose(float(own), float(wanted), rel_tol=DIGITS), now

    @contextmanager
    def raises(self, *errors: type[BaseException]) -> Iterator[pytest.ExceptionInfo[BaseException]]:
        """`pytest.raises`, whose message is the golden one."""
        with pytest.raises(errors) as found:
            yield found
        self.holds(str(found.value))

    def _normal(self, text: str) -> str:
        """Without the folders of the test, of its session and of this checkout, and without blanks at ends of lines."""
        text = text.replace(self.folder, "<folder>").replace(self.session, "<session>").replace(str(TESTS), "<tests>")
        return "\n".join(line.rstrip() for line in text.strip().splitlines())


def _read(file: Path) -> dict[str, str]:
    return tomllib.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def _write(file: Path, key: str, text: str) -> None:
    known = _read(file) | {key: text}
    lines = [f"{_quoted(name)} = {_quoted(known[name])}" for name in sorted(known)]
    file.write_text(
        "# Written by pytest --golden=write -n 0 -m ''; see tests/golden.py.\n" + "\n".join(lines) + "\n", "utf-8"
    )


def _quoted(text: str) -> str:
    """A string of TOML; one of several lines as it is seen."""
    import json

    if "\n" not in text:
        return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
    body = json.dumps(text, ensure_ascii=False)[1:-1].replace("\\n", "\n").replace("\x7f", "\\u007f")
    return f'"""\n{body}"""'
