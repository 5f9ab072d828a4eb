"""The page on paper: A4, as PDF."""

from __future__ import annotations

import importlib
import logging
from typing import Any

from ambid.errors import InputError

TO_INSTALL = (
    "pip install 'ambid[pdf]'; WeasyPrint also needs the library Pango of the system "
    "(Debian, Ubuntu: apt install libpango-1.0-0 libpangoft2-1.0-0; macOS: brew install pango), "
    "or write .html and print that from a browser"
)


def weasyprint() -> Any:
    """The package that lays the page out.

    Raises
    ------
    InputError
        If it is not installed, or Pango is not.
    """
    try:
        found = importlib.import_module("weasyprint")
    except ImportError:
        raise InputError(f"a report as PDF needs the package weasyprint: {TO_INSTALL}") from None
    except OSError as error:  # it is there, and does not find Pango
        raise InputError(f"a report as PDF needs Pango ({str(error).splitlines()[0]}): {TO_INSTALL}") from None
    logging.getLogger("weasyprint").setLevel(logging.ERROR)  # warnings of styles for browsers
    return found


def as_pdf(page: str) -> bytes:
    """A page, which must hold all that it needs, as PDF with bookmarks and tags; nothing is fetched."""
    weasy = weasyprint()
    document = weasy.HTML(string=page, url_fetcher=weasy.urls.URLFetcher(allowed_protocols={"data"}))
    return bytes(document.write_pdf(pdf_tags=True))
