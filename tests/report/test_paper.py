"""The same page on paper: A4, nothing cut off, no page but the last half empty."""

import pytest

from ambid.diagnosis import Diagnosis
from ambid.errors import InputError
from ambid.findings import REMARK
from ambid.report import report, write_report

INCH = 96.0


@pytest.fixture(scope="module")
def weasyprint():
    """The tests are skipped where it is not there, or does not find Pango."""
    try:
        return report.weasyprint()
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def sheets(weasyprint, written):
    return weasyprint.HTML(filename=written).render().pages


def boxes(box):
    yield box
    for child in getattr(box, "children", ()):
        yield from boxes(child)


def test_html_and_pdf_are_written_together(weasyprint, explained, tmp_path):
    html, paper = tmp_path / "report.html", tmp_path / "report.pdf"
    short = Diagnosis.uninformative(explained.model, explained.records, [REMARK(text="why")], 0.0)
    assert write_report(short, html, paper) == html
    assert paper.read_bytes().startswith(b"%PDF-")


@pytest.mark.slow
def test_no_page_but_the_last_is_half_empty(sheets):
    for sheet in sheets[:-1]:
        ends = [
            box.position_y + box.height
            for box in boxes(sheet._page_box)
            if (getattr(box, "text", "") or box.element_tag == "img") and box.position_y < 0.93 * sheet.height
        ]
        assert max(ends) > 0.7 * sheet.height


@pytest.mark.slow
def test_on_a4_nothing_is_cut_off(sheets):
    assert 4 <= len(sheets) <= 12
    for sheet in sheets:
        assert (sheet.width / INCH, sheet.height / INCH) == pytest.approx((8.27, 11.69), abs=0.01)
        right = sheet.width - 0.5 * INCH
        for box in boxes(sheet._page_box):
            if getattr(box, "text", "") or box.element_tag in ("img", "table"):
                assert 0.0 <= box.position_x <= box.position_x + box.width <= right
