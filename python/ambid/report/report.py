"""The story of a diagnosis as one self-contained HTML file, for reading, printing and passing on."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ambid.diagnosis import Diagnosis
from ambid.errors import InputError, printable
from ambid.report.chapters import story
from ambid.threads import with_one_blas_thread
from ambid.writing import require_writable, whole_file

__all__ = ["write_report"]

SUFFIXES = (".html", ".htm")


@with_one_blas_thread
def write_report(diagnosis: Diagnosis, path: str | Path) -> Path:
    """Write a diagnosis as HTML: verdict, what to do next, where, which effect, what adding it did, shape, signals.

    All pictures and styles are in the file; it needs no network and no script.

    Parameters
    ----------
    diagnosis : Diagnosis
    path : str or Path
        With the suffix .html or .htm.

    Returns
    -------
    Path
        The file that was written.

    Raises
    ------
    InputError
        If the suffix is another one, or the folder does not exist.
    OutputError
        If the file cannot be written; what was there stands.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: the suffix is {path.suffix or 'missing'}; expected {' or '.join(SUFFIXES)}")
    require_writable(path)
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("template.html").render(story(diagnosis))
    with whole_file(path) as stream:
        stream.write(printable(page).encode(errors="backslashreplace"))
    return path
