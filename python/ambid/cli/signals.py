"""Ctrl-C and SIGTERM: what a signal does depends on what would be lost.

Before the job, and after all, the process ends at once. In the job a KeyboardInterrupt is raised, so that what is done
comes back. While files are written and results are printed, the first signal waits, and the second interrupts.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import Enum, auto
from typing import Any, TypeVar

from ambid.errors import Stopped

T = TypeVar("T")
NOTHING = "before anything was done; nothing was written"


class Stage(Enum):
    """How far the command is."""

    BEFORE = auto()
    JOB = auto()
    RESULTS = auto()
    AFTER = auto()


class _Watch:
    """What is known of this process: its signal handlers are global, and so is this."""

    stage = Stage.BEFORE
    came: int | None = None


def watch() -> None:
    """Take over the signals that nobody ignores, as a shell lets a job in the background do."""
    _Watch.stage, _Watch.came = Stage.BEFORE, None
    for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL)):
        if signal.getsignal(number) == usual:
            signal.signal(number, _on_signal)
    sys.unraisablehook = _on_unraisable


def finish(code: int) -> int:
    """Exit code of the process; from here on a signal ends it without a word."""
    _Watch.stage = Stage.AFTER
    return code if _Watch.came is None else exit_code()


def exit_code() -> int:
    """Exit code after a signal, 128 and its number: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + (_Watch.came or signal.SIGINT)


@contextmanager
def stoppable(left: str = NOTHING) -> Iterator[None]:
    """Hold the job of a command: a signal raises KeyboardInterrupt in it, and waits for the results after it.

    A job that hands nothing back ends the command; `left` says what is there then.
    """
    _Watch.stage = Stage.JOB
    try:
        yield
    except (KeyboardInterrupt, Exception) as error:
        if _Watch.came is None and not isinstance(error, KeyboardInterrupt):
            raise  # else a library may have made another error of the interrupt
        print(f"{stopped()} {left}", file=sys.stderr)
        raise SystemExit(exit_code()) from None
    finally:
        begin_results()


def begin_results() -> None:
    """From here on files are written, also where a command had no job: the first signal waits."""
    _Watch.stage = Stage.RESULTS


def done_of(job: Callable[[], T], kind: type[T]) -> tuple[T, bool]:
    """What a job gives, or has to show when a signal ends it, and whether one did; from then on signals wait.

    Where it has nothing of this kind to show, the interrupt passes on.
    """
    try:
        result, is_stopped = job(), False
    except Stopped as early:
        if not isinstance(early.result, kind):
            raise
        result, is_stopped = early.result, True
    begin_results()
    return result, is_stopped


@contextmanager
def droppable() -> Iterator[None]:
    """Hold a part of the job that the result can do without: a signal ends this part alone."""
    _Watch.stage = Stage.JOB
    try:
        yield
    except (KeyboardInterrupt, Exception) as error:
        if _Watch.came is None and not isinstance(error, KeyboardInterrupt):
            raise  # as above
    finally:
        begin_results()


def came() -> bool:
    """Whether a signal has come."""
    return _Watch.came is not None


def stopped() -> str:
    """In words, by what the command was stopped."""
    return f"stopped by {'SIGTERM' if _Watch.came == signal.SIGTERM else 'Ctrl-C'}"


def _on_signal(number: int, _: object) -> None:
    again, _Watch.came = _Watch.came is not None, _Watch.came or number
    if _Watch.stage is Stage.BEFORE:
        _say(f"{stopped()} {NOTHING}")
    if _Watch.stage in (Stage.BEFORE, Stage.AFTER):
        os._exit(exit_code())  # an import that is interrupted may raise anything
    if _Watch.stage is Stage.RESULTS and not again:
        _say(f"{stopped()}; what is done is written first, and once more ends it at once")
        return
    raise KeyboardInterrupt


def _say(line: str) -> None:
    """Write to stderr as a signal handler may: print() may be at work already."""
    with suppress(OSError):
        os.write(2, f"{line}\n".encode())


def _on_unraisable(raised: Any) -> None:
    if not issubclass(raised.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(raised)
    elif hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _once_more)
        # a callback of a library may swallow a KeyboardInterrupt, which is raised again
        signal.setitimer(signal.ITIMER_REAL, 0.02)


def _once_more(*_: object) -> None:
    if _Watch.stage is Stage.JOB:
        raise KeyboardInterrupt
