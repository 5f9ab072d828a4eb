"""Runs on a cluster of dask distributed: workers come and go, and one that dies takes no other run with it."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import BrokenExecutor
from importlib.metadata import version
from typing import Any
from uuid import uuid4

from ambid.errors import InputError
from ambid.monte_carlo.plan import Plan
from ambid.monte_carlo.runs import Row, failed_row, rows_of

__all__ = ["made_on_cluster"]


def made_on_cluster(client: Any, plan: Plan, tasks: Sequence[Sequence[int]]) -> Generator[list[Row]]:
    """The rows of each task, in whatever order they come; those left are called off when no longer wanted.

    The plan is the result of a task of its own: it is sent to the scheduler once, handed from worker to worker, and,
    unlike scattered data, made again when all that had it are gone. A lost task is run again by dask. Where all workers
    die that try a task, dask may blame what waited there too: so its runs are tried at the end, one at a time, and one
    that kills its workers alone is a failed row.

    Parameters
    ----------
    client : distributed.Client
    plan : Plan
    tasks : sequence of sequence of int
        Numbers of runs that one worker makes.

    Raises
    ------
    InputError
        If a worker has another version of ambid.
    BrokenExecutor
        If the scheduler has gone.
    """
    from distributed import CancelledError, KilledWorker, as_completed

    name = uuid4().hex
    sent = client.submit(_received, plan, version("ambid"), key=f"ambid-plan-{name}")
    left: dict[Any, Sequence[int]] = {}
    suspects: list[int] = []

    def submit(several: Sequence[Sequence[int]]) -> list[Any]:
        keys = [(f"ambid-runs-{name}", runs[0], len(runs)) for runs in several]
        futures: list[Any] = client.map(make_rows, several, plan=sent, key=keys)
        left.update(zip(futures, several, strict=True))
        return futures

    try:
        for future in as_completed(submit(tasks), loop=client.loop):
            runs = left.pop(future)
            try:
                yield future.result()
            except KilledWorker:
                suspects += runs
        for run in suspects:
            (future,) = submit([[run]])
            try:
                yield future.result()
            except KilledWorker as killed:
                times = killed.allowed_failures + 1
                yield [failed_row(plan, run, f"killed its worker, or took all its memory, in {times} of {times} tries")]
            del left[future]
    except CancelledError:
        raise BrokenExecutor("the scheduler answers no more, or has cancelled the runs") from None
    finally:
        client.cancel(list(left))


def _received(plan: Plan, sender: str) -> Plan:
    if sender != (own := version("ambid")):
        raise InputError(f"a worker has ambid {own}, and the plan is of {sender}; install the same everywhere")
    return plan


def make_rows(runs: Sequence[int], plan: Plan) -> list[Row]:
    """The rows of one task, in a worker."""
    return rows_of(plan, runs)
