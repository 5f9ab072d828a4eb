"""The story of a diagnosis as one self-contained file, for reading, printing and passing on."""

import importlib
import logging
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ambid.diagnosis import Diagnosis
from ambid.errors import InputError, OutputError, printable
from ambid.report.chapters import story
from ambid.symbols import in_page
from ambid.threads import with_one_blas_thread
from ambid.writing import require_writable, whole_file

HTML, PDF = (".html", ".htm"), ".pdf"


@with_one_blas_thread
def write_report(diagnosis: Diagnosis, path: str | Path, *further: str | Path) -> Path:
    """Write a diagnosis as HTML or PDF.

    Verdict, machine and records with hashes of their files, before and after, where, which effect, what it did to the
    parameters, what is left, margins, and what to do next. All pictures and styles are in the file; it needs no network
    and no script, and prints on A4.

    Parameters
    ----------
    diagnosis : Diagnosis
    path : str or Path
        With the suffix .html, .htm or .pdf.
    *further : str or Path
        More files for the same page, such as its PDF.

    Returns
    -------
    Path
        The first file that was written.

    Raises
    ------
    InputError
        If a suffix is another one, the folder does not exist, or WeasyPrint, which .pdf needs, is not installed.
    OutputError
        If a file cannot be written; what was there stands, and the others are written.
    """
    paths = [Path(own) for own in (path, *further)]
    for own in paths:
        check_suffix(own)
        require_writable(own)
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = printable(in_page(environment.get_template("report.html").render(story(diagnosis))))
    errors: list[OutputError] = []
    for own in paths:
        content = as_pdf(page) if own.suffix.lower() == PDF else page.encode(errors="backslashreplace")
        try:
            with whole_file(own) as stream:
                stream.write(content)
        except OutputError as error:
            errors.append(error)
    if errors:
        raise errors[0]
    return paths[0]


def check_suffix(path: Path) -> None:
    """Refuse a file that no report can be written to, before any work is done.

    Raises
    ------
    InputError
        If the suffix is another one than .html, .htm, .pdf, or what .pdf needs is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in (*HTML, PDF):
        raise InputError(f"{path}: the suffix is {path.suffix or 'missing'}; expected .html or .pdf")
    if suffix == PDF:
        weasyprint()


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
