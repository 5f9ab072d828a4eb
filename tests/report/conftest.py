"""What the tests of the report share: one report, made once."""

import pytest

from ambid.report import pictures, standing, write_report
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
def page(monkeypatch, tmp_path):
    """The page of a diagnosis, with pictures that are not drawn, and few draws: those of `whole` are."""
    empty = "data:image/gif;base64,R0lGODlhAQABAAAAACw="
    monkeypatch.setattr(pictures, "as_picture", lambda figure, caption: pictures.Picture(empty, caption, 1.0))
    monkeypatch.setattr(standing, "DRAWS", 40)
    return lambda diagnosis: Page(write_report(diagnosis, tmp_path / "report.html").read_text(encoding="utf-8"))
