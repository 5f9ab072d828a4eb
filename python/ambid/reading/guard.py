"""The one place where whatever a parser raises becomes an error that names the file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ambid.errors import AmbidError, InputError

__all__ = ["reading"]


@contextmanager
def reading(path: str | Path, error: type[InputError], what: str, remedy: str) -> Iterator[None]:
    """Read a file within: errors of our own pass, all others become one that names the file.

    A damaged byte leads a parser to any exception at all, so that none can be listed here.

    Parameters
    ----------
    path : str or Path
    error : type of InputError
        To raise.
    what : str
        That the file should be, such as ``a readable .mat file``.
    remedy : str
        What to do.

    Raises
    ------
    error
    """
    try:
        yield
    except AmbidError:
        raise
    except MemoryError:
        raise error(f"{path}: does not fit into memory; cut it, or read it on a larger machine") from None
    except RecursionError:
        raise error(f"{path}: not {what} (nested too deeply); {remedy}") from None
    except OSError as found:
        if found.filename is not None:
            raise error(f"{path}: cannot be read ({found.strerror}); check the path") from None
        raise error(f"{path}: not {what} ({found}); {remedy}") from found
    except Exception as found:
        raise error(f"{path}: not {what} ({type(found).__name__}: {found}); {remedy}") from found
