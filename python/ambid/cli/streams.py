"""stdout and stderr that never stop a job: what cannot be printed is stated at the end, when all files are written."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any, TextIO


class _Patient(io.RawIOBase):
    """A stream whose failure is kept for later; what comes after it is dropped."""

    failure: OSError | None = None

    def __init__(self, raw: Any) -> None:
        self._raw = raw

    def write(self, data: Any) -> int:
        """Write bytes; returns how many, as if all were well."""
        if self.failure is None:
            try:
                return self._raw.write(data)
            except OSError as error:
                self.failure = error
        return len(data)

    def writable(self) -> bool:
        """True."""
        return True

    def fileno(self) -> int:
        """That of the stream."""
        return self._raw.fileno()

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._raw.isatty()


def protect() -> None:
    """Make stdout and stderr patient, with escapes for what their encoding lacks; streams that are closed too."""
    _fill()
    sys.stdin = sys.stdin or io.TextIOWrapper(io.FileIO(0, closefd=False))
    if sys.stdout is sys.__stdout__:  # else it is a caller's own
        sys.stdout = _patient(sys.stdout, 1)
    if sys.stderr is sys.__stderr__:
        sys.stderr = _patient(sys.stderr, 2)


def finish(code: int) -> int:
    """Flush both streams; the exit code, which says so where stdout failed in a job that did well."""
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    failure = raw.failure if isinstance(raw, _Patient) else None
    if failure is not None and failure.errno != errno.EPIPE:
        print(
            f"error: stdout: cannot be written ({failure.strerror}); files that were asked for were written",
            file=sys.stderr,
        )
    sys.stderr.flush()
    if failure is None or code != 0:
        return code
    # exit code when the reader of stdout has gone, as `head` goes: 128 and SIGPIPE, as a shell reports any program
    return 141 if failure.errno == errno.EPIPE else 1


def _fill() -> None:
    """Keep a file from getting the number of a standard stream that is closed; printing to one is an error."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if number == 1 else os.O_RDWR)


def _patient(stream: TextIO | None, number: int) -> TextIO:
    binary: Any = io.FileIO(number, "w", closefd=False) if stream is None else stream.buffer
    raw = _Patient(getattr(binary, "raw", binary))  # with `python -u` there is no buffer
    encoding = "utf-8" if stream is None else stream.encoding
    buffer = io.BufferedWriter(raw)
    return io.TextIOWrapper(buffer, encoding, "backslashreplace", line_buffering=number == 2 or raw.isatty())
