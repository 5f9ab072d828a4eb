"""What a person at the terminal sees and says: tables on stdout, progress and questions on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.prompt import Prompt
from rich.text import Text

import ambid
from ambid.errors import InputError, printable

if TYPE_CHECKING:
    from ambid.diagnosis import Candidate

status = Console(stderr=True)


def say(line: str, quiet: bool) -> None:
    """Print a line of progress, where a terminal is attached."""
    if not quiet and status.is_terminal:
        status.print(Text(printable(line)), soft_wrap=True)


@contextmanager
def progress(quiet: bool, what: str) -> Iterator[Callable[[str], None]]:
    """A line that says how far the work is, where a terminal is attached."""
    if quiet or not status.is_terminal:
        yield lambda _: None
        return
    with status.status(f"{what} ...") as line:
        yield lambda text: line.update(Text(printable(f"{what}: {text}")))


def with_time_left(report: Callable[[str], None]) -> Callable[[str, int, int], None]:
    """Report what is being done, how much of it, and how long the rest takes if it goes on like this."""
    begun: dict[str, float] = {}

    def show(what: str, done: int, total: int) -> None:
        work = what.split()[0]
        if done == 0:
            begun[work] = time.monotonic()
        left = (time.monotonic() - begun[work]) / done * (total - done) if done else 0.0
        report(f"{what}, {done + 1} of {total}" + (f", {left:.0f} s left" if left >= 1.0 else ""))

    return show


def require_terminal(option: str) -> None:
    """Refuse to ask where nobody can answer."""
    if not (sys.stdin.isatty() and status.is_terminal):
        raise InputError(f"{option}: there is no terminal to ask on; leave it out, or choose with --effects NAME,...")


def choose(ranking: ambid.Ranking, candidate: Candidate) -> bool | Candidate:
    """Show a ranking, and ask whether the candidate that did best when refitted is to be added, or another of it."""
    status.print(Text(printable(f"\n{ranking}\n")), soft_wrap=True)
    numbered = {str(k): each for k, each in enumerate(ranking.candidates, 1)}
    status.print(Text(printable(", ".join(f"{k} {each.effect.name}" for k, each in numbered.items()))), soft_wrap=True)
    question = f"Best of those refitted: {candidate.effect.name}. Add it? Or the number of another"
    answer = Prompt.ask(
        f"{question} \\[y/n/1-{len(numbered)}]", choices=["y", "n", *numbered], show_choices=False, console=status
    )
    return numbered.get(answer, answer == "y")
