"""A long job beside the server: it tells how far it is, and a person may end it."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread
from typing import Any, TypeVar

from ambid.errors import AmbidError, Cancelled
from ambid.workbench.session import Progress

__all__ = ["Job"]

Result = TypeVar("Result")


class Job:
    """One call in a thread of its own.

    Parameters
    ----------
    what : str
        Such as ``fit``.
    call : callable
        The work; told where to tell its progress.
    done : callable
        Takes the result, in the same thread; not called for a job that failed or was cancelled.
    """

    def __init__(self, what: str, call: Callable[[Progress], Result], done: Callable[[Result], None]) -> None:
        self.what, self._call, self._done = what, call, done
        self._now: tuple[str, int, int] = (what, 0, 0)
        self._cancelled, self._error = Event(), ""
        self._thread = Thread(target=self._run, name=what, daemon=True)
        self._thread.start()

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        return self._thread.is_alive()

    def cancel(self) -> None:
        """End it when it tells its progress next; what it has found is dropped."""
        self._cancelled.set()

    def as_dict(self) -> dict[str, Any]:
        """Plain data: what was asked, what it is doing, how far it is, and what went wrong."""
        doing, done, total = self._now
        return {
            "running": self.is_running,
            "what": self.what,
            "doing": doing,
            "done": done,
            "total": total,
            "cancelled": self._cancelled.is_set(),
            "error": self._error,
        }

    def _report(self, doing: str, done: int, total: int) -> None:
        if self._cancelled.is_set():
            raise Cancelled(f"{self.what} was cancelled; nothing has changed")
        self._now = (doing, done, total)

    def _run(self) -> None:
        try:
            found = self._call(self._report)
            self._report(self.what, 1, 1)  # the last moment to cancel
            self._done(found)
        except AmbidError as error:
            self._error = str(error)
        except Exception as error:  # the page must hear of it: nobody reads a thread's traceback
            self._error = f"{self.what} failed: {type(error).__name__}: {error}"
            raise
