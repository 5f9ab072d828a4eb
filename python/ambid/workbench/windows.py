"""Browser windows, each with a session of its own: what is done in one leaves the others as they are."""

import secrets
from collections import OrderedDict
from collections.abc import Callable
from threading import Event, Lock, Thread
from typing import Any, TypeVar

from ambid.diagnosis.ranking import Progress
from ambid.errors import AmbidError, Cancelled, InputError, StaleWindow
from ambid.workbench.exporting import as_report
from ambid.workbench.session import Session
from ambid.workbench.views import overview

Result = TypeVar("Result")


class Window:
    """The present step of one window, and the job that makes the next.

    A window that was duplicated shares its session; the one whose view is older is warned before it changes anything.
    """

    def __init__(self, session: Session) -> None:
        self._present, self.report = (0, session), b""
        self.job: Job | None = None
        self._jobs, self._lock = 0, Lock()

    def view(self) -> dict[str, Any]:
        """All that the page shows beside its charts."""
        job = None if self.job is None else self.job.as_dict() | {"number": self._jobs}
        revision, session = self._present  # after the job: one that has ended has made its step
        return overview(session) | {"revision": revision, "job": job}

    @property
    def session(self) -> Session:
        """The present step."""
        return self._present[1]

    def at(self, revision: int) -> Session | None:
        """The step that a page shows; none where the window has gone on since."""
        present, session = self._present
        return session if revision == present else None

    def go(self, revision: int, step: Callable[[Session], Session]) -> None:
        """Take a step that is quick.

        Raises
        ------
        StaleWindow
            If the page shows an older step, or a job is running.
        """
        with self._lock:
            self._require_present(revision)
            self._take(step(self.session))

    def start(self, revision: int, what: str, step: Callable[[Session, Progress], Session]) -> None:
        """Begin a step that is long; `StaleWindow` as above."""
        self._begin(revision, what, step, self._take)

    def start_report(self, revision: int) -> None:
        """Begin to write the report; `StaleWindow` as above."""
        self._begin(revision, "report", as_report, self._keep)

    def cancel(self) -> None:
        """End the job, if one is running."""
        if self.job is not None:
            self.job.cancel()

    def _begin(
        self, revision: int, what: str, work: Callable[[Session, Progress], Result], done: Callable[[Result], None]
    ) -> None:
        with self._lock:
            self._require_present(revision)
            session = self.session
            self._jobs += 1
            self.job = Job(what, lambda progress: work(session, progress), done)

    def _require_present(self, revision: int) -> None:
        if self.job is not None and self.job.is_running:
            raise StaleWindow(f"{self.job.what} is running in this session; wait for it, or cancel it")
        if self.at(revision) is None:
            raise StaleWindow("another window has changed this session; reload the page to see how it stands")

    def _take(self, session: Session) -> None:
        self._present = (self._present[0] + 1, session)

    def _keep(self, report: bytes) -> None:
        self.report = report


class Windows:
    """All windows of a server; each begins at the first step of the bench."""

    def __init__(self, first: Session) -> None:
        self._first, self._open = first, OrderedDict[str, Window]()
        self._lock = Lock()

    @property
    def sessions(self) -> list[Session]:
        """The present step of every window, that which was used last at the end; the first step where none was open."""
        with self._lock:
            return [window.session for window in self._open.values()] or [self._first]

    def open(self) -> str:
        """A new window's name."""
        name = secrets.token_hex(8)
        with self._lock:
            self._open[name] = Window(self._first)
            if len(self._open) > 32:  # sessions that are kept; the one that nobody has used for longest goes first
                self._open.popitem(last=False)
        return name

    def find(self, name: str) -> Window:
        """The window of that name.

        Raises
        ------
        InputError
            If it is not known, or has been dropped for newer ones.
        """
        with self._lock:
            if name not in self._open:
                raise InputError("this session is not known here; reload the page for a new one")
            self._open.move_to_end(name)
            return self._open[name]


class Job:
    """One call in a thread of its own.

    Parameters
    ----------
    what : str
        Such as ``fit``.
    call : callable
        The work; takes what to report its progress to.
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
        """End it when it reports its progress next; what it has found is dropped."""
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
