"""How every file is written: whole or not at all."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from ambid.errors import InputError, OutputError

TEMPORARY = ".ambid-{}.tmp"
"""Name of the file that grows beside the one to be replaced; a killed process may leave one, which may be deleted."""


@contextmanager
def whole_file(path: str | Path) -> Iterator[BinaryIO]:
    """Open a file to be written; it gets its name when the block ends well, and what was there stands until then.

    The stream writes a temporary file in the same folder, which then takes the place of the file, with its permissions;
    through a symbolic link, that of the file it leads to. What is no regular file, such as a pipe or ``/dev/stdout``,
    takes the content when it is complete.

    Parameters
    ----------
    path : str or Path

    Yields
    ------
    BinaryIO

    Raises
    ------
    InputError
        If the path is a folder, or is in none.
    OutputError
        If the file cannot be written; no temporary file is left.
    """
    path = Path(path)
    require_writable(path)
    try:
        if is_device(path):
            content = BytesIO()
            yield content
            with path.open("wb") as device:
                device.write(content.getbuffer())
            return
        target = Path(os.path.realpath(path))
        temporary = target.with_name(TEMPORARY.format(f"{os.getpid()}-{os.urandom(4).hex()}"))
        try:
            with temporary.open("xb") as stream:
                if target.exists():  # before there is anything in it: the old file may be private
                    _take_over(target.stat(), temporary)
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise _cannot_be_written(path, error) from error


def require_writable(path: Path) -> None:
    """Refuse a file that could not be written, before any work is done.

    Raises
    ------
    InputError
        If the path is a folder, or is in none.
    OutputError
        If there is no permission to write it.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path}: cannot be written, it is a folder; give the name of a file")
        folder = Path(os.path.realpath(path)).parent
        if not folder.is_dir():
            raise InputError(f"{path}: cannot be written, there is no folder {folder}; make it, or give another file")
        is_new = not path.exists()
    except OSError as error:  # a name that is too long
        raise _cannot_be_written(path, error) from error
    if not is_new and not os.access(path, os.W_OK):
        raise OutputError(f"{path}: cannot be written, it is write-protected; lift that, or give another file")
    if (is_new or not is_device(path)) and not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: cannot be written, no permission in the folder {folder}; give a file elsewhere")


def make_folder(path: Path) -> None:
    """Make a folder, with those above it, where there is none.

    Raises
    ------
    InputError
        If a file is in its place.
    OutputError
        If it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{path}: a file is in the place of this folder; give another folder") from None
    except OSError as error:
        raise _cannot_be_written(path, error) from error


def is_device(path: Path) -> bool:
    """Whether a path is there and is no regular file: a pipe, a terminal, ``/dev/null``."""
    return path.exists() and not path.is_file()


def _take_over(old: os.stat_result, new: Path) -> None:
    """Give a file the permissions of the one that it replaces, and its owner where that is allowed."""
    if hasattr(os, "chown"):
        with suppress(PermissionError):
            os.chown(new, old.st_uid, old.st_gid)
    new.chmod(stat.S_IMODE(old.st_mode))


def _cannot_be_written(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"{path}: cannot be written ({error.strerror or error}); nothing was changed there; "
        "make room, or give a file elsewhere"
    )
