"""What the tests of the report share: one report, made once."""

import pytest

from ambid.report import write_report
from report.page import Page


@pytest.fixture(scope="package")
def written(explained, tmp_path_factory):
    """The file of its report."""
    path = write_report(explained, tmp_path_factory.mktemp("report") / "report.html")
    assert path.stat().st_size < 5e6
    return path


@pytest.fixture(scope="package")
def whole(written):
    return Page(written.read_text(encoding="utf-8"))


@pytest.fixture
def page(undrawn, tmp_path):
    """The page of a diagnosis, with pictures that are not drawn: those of `whole` are."""
    return lambda diagnosis: Page(write_report(diagnosis, tmp_path / "report.html").read_text(encoding="utf-8"))
