"""Claims that tests hold against independent references, and the rows that they leave in the validation document.

`pytest --validated=write -m ''` runs the tests that have the fixture `validated`, and renews their rows of `ROWS`, of
which `python/docs/_ext/validation.py` makes tables. A row is written by the assertion alone.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from string import Formatter
from typing import Any

import numpy as np
import pytest

from places import ROOT, TESTS
from source import claims, sources

ROWS = ROOT / "python" / "docs" / "validation.jsonl"
PROPERTY = "validated"


@dataclass(frozen=True)
class Validated:
    """Asserts the claims of one test."""

    item: pytest.Item

    def __call__(self, claim: str, reference: str, figure: Any, tolerance: float) -> None:
        """Assert that a deviation from a reference is within its tolerance.

        Parameters
        ----------
        claim : str
            What agrees, and the measure of the deviation; of several cases of a claim the worst is shown.
        reference : str
            Closed form with its source, or program; ``{package}`` is the version of that distribution.
        figure : array_like
            Deviations; the largest counts.
        tolerance : float
            The largest that is allowed.
        """
        worst = float(np.max(np.abs(figure)))
        assert worst <= tolerance, f"{claim}: {worst:.3g}, at most {tolerance:.3g} ({reference})"
        packages = [name for _, name, _, _ in Formatter().parse(reference) if name]
        row = {"claim": claim, "reference": reference, "versions": {name: version(name) for name in packages}}
        self.item.user_properties.append((PROPERTY, row | {"tolerance": float(tolerance), "figure": worst}))


def relative(found: Any, expected: Any) -> np.ndarray:
    """Deviation of each number, relative to that of the reference."""
    return np.abs(np.asarray(found) - expected) / np.abs(expected)


def of_peak(found: Any, expected: Any) -> np.ndarray:
    """Deviation of each sample, relative to the peak of its column of the reference."""
    assert np.shape(found) == np.shape(expected)
    return np.abs(np.asarray(found) - expected) / np.abs(expected).max(axis=0)


class Writer:
    """Gathers the rows of a run, whichever worker made them, and renews those of the file."""

    def __init__(self) -> None:
        self.cases: dict[tuple[str, str], list[dict[str, Any]]] = {}
        self.ran: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Enter the claims of a test that has ended."""
        if report.when == "call":
            test = report.nodeid.partition("[")[0]
            self.ran.add(test)
            for name, row in report.user_properties:
                if name == PROPERTY:
                    self.cases.setdefault((test, row["claim"]), []).append(row)

    def pytest_sessionfinish(self) -> None:
        """Write the worst case of each claim; rows of tests that did not run stay while their claims are made."""
        made = {(test, claim) for test, claim, _ in claimed()}
        kept = [row for row in read() if row["test"] not in self.ran and (row["test"], row["claim"]) in made]
        today = date.today().isoformat()
        for (test, _), rows in self.cases.items():
            worst = max(rows, key=lambda row: row["figure"] / (row["tolerance"] or 1.0))
            figure = float(f"{worst['figure']:.2g}")
            kept.append({"test": test, **worst, "figure": figure, "cases": len(rows), "date": today})
        kept.sort(key=lambda row: (row["test"], row["claim"]))
        ROWS.write_text("".join(json.dumps(row, ensure_ascii=False) + "\n" for row in kept), encoding="utf-8")


def read() -> list[dict[str, Any]]:
    """The rows of the validation document."""
    return [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()] if ROWS.exists() else []


def claimed() -> Iterator[tuple[str, str, str]]:
    """Test, claim and reference of everything that the sources of the tests hold against a reference."""
    for path, tree in sources(TESTS, without="benchmarks"):
        for test, claim, reference in claims(tree):
            yield f"{path.relative_to(ROOT).as_posix()}::{test}", claim, reference


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--validated`."""
    parser.addoption("--validated", choices=("hold", "write"), default="hold", help="renew the rows of the validation")


def pytest_configure(config: pytest.Config) -> None:
    """Gather rows where they are asked for, once."""
    if config.getoption("validated") == "write" and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Writer(), "validation")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run nothing else then."""
    if config.getoption("validated") == "write":
        items[:] = [item for item in items if PROPERTY in getattr(item, "fixturenames", ())]


@pytest.fixture
def validated(request: pytest.FixtureRequest) -> Validated:
    """Asserts a claim against an independent reference, and records it."""
    return Validated(request.node)
