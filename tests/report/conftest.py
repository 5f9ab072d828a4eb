"""What the tests of the report share: one report, and the same with its pictures, each made once."""

import pytest

from ambid.report import write_report
from report.page import Page
from undrawn import undraw


@pytest.fixture(scope="package")
def written(explained, tmp_path_factory):
    """The file of the report with its pictures, which take long."""
    path = write_report(explained, tmp_path_factory.mktemp("report") / "report.html")
    assert path.stat().st_size < 5e6
    return path


@pytest.fixture(scope="package")
def whole(explained, tmp_path_factory):
    """The page without drawing them."""
    with pytest.MonkeyPatch.context() as patch:
        undraw(patch)
        path = write_report(explained, tmp_path_factory.mktemp("report") / "report.html")
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture
def page(undrawn, tmp_path):
    """The page of a diagnosis, with pictures that are not drawn: those of `written` are."""
    return lambda diagnosis: Page(write_report(diagnosis, tmp_path / "report.html").read_text(encoding="utf-8"))
