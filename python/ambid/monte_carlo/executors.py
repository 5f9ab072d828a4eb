"""Runs that an executor makes: the plan goes to its workers, tasks of a few runs follow, rows come back."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Generator, Sequence
from concurrent.futures import BrokenExecutor, Future, as_completed
from functools import lru_cache, partial
from importlib.metadata import version
from typing import Any, NamedTuple
from uuid import uuid4

from ambid.errors import InputError
from ambid.monte_carlo.plan import Plan
from ambid.monte_carlo.runs import Row, failed_row, rows_of

HELD: dict[str, Plan] = {}
"""Plans that this process was given before any task, by their key."""


def hold_plan(plan: Plan) -> None:
    """Keep a plan in a worker, so that it is sent once and not with every task: the initializer of an executor.

    Parameters
    ----------
    plan : Plan
    """
    HELD[plan.key] = plan


def made_by(executor: Any, plan: Plan, tasks: Sequence[Sequence[int]]) -> Generator[list[Row]]:
    """The rows of each task, in whatever order they come; tasks not begun are called off when no longer wanted.

    Parameters
    ----------
    executor : object
        As for `run_monte_carlo`.
    plan : Plan
    tasks : sequence of sequence of int
        Numbers of runs that one worker makes.

    Raises
    ------
    InputError
        If the executor is none, or a worker has another version of ambid.
    BrokenExecutor
        If a worker, or the scheduler, has gone.
    """
    if (client := _client_of_dask(executor)) is not None:
        yield from _on_cluster(client, plan, tasks)
    elif hasattr(executor, "submit"):
        yield from _submitted(executor, plan, tasks)
    elif hasattr(executor, "map"):
        yield from executor.map(partial(_rows_by, _Parcel.of(plan)), tasks)
    else:
        raise InputError(
            f"executor {type(executor).__name__}: has neither submit nor map; give one of concurrent.futures, "
            "mpi4py.futures or dask distributed"
        )


def _client_of_dask(executor: Any) -> Any:
    """The client behind what dask hands out; None for any other executor."""
    if "distributed" not in sys.modules:
        return None
    from distributed import Client
    from distributed.cfexecutor import ClientExecutor

    if isinstance(executor, ClientExecutor):
        # its futures cannot be the arguments of tasks, so that it would send the plan with each
        return executor._client
    return executor if isinstance(executor, Client) else None


def _submitted(executor: Any, plan: Plan, tasks: Sequence[Sequence[int]]) -> Generator[list[Row]]:
    given: _Parcel | str = plan.key if executor.submit(holds_plan, plan.key).result() else _Parcel.of(plan)
    futures: set[Future[list[Row]]] = set()
    try:
        for runs in tasks:
            futures.add(executor.submit(_rows_by, given, runs))
        for future in as_completed(futures):
            futures.remove(future)
            yield future.result()
    finally:
        for future in futures:
            future.cancel()


def holds_plan(key: str) -> bool:
    """Whether this process has the plan of a key."""
    return key in HELD


class _Parcel(NamedTuple):
    """A plan that goes with every task, and is opened once by each worker."""

    version: str
    content: bytes

    @classmethod
    def of(cls, plan: Plan) -> _Parcel:
        return cls(version("ambid"), pickle.dumps(plan))


@lru_cache(maxsize=1)
def _opened(parcel: _Parcel) -> Plan:
    _require_version(parcel.version)
    plan: Plan = pickle.loads(parcel.content)
    return plan


def _rows_by(given: _Parcel | str, runs: Sequence[int]) -> list[Row]:
    """The rows of one task, in a worker that is sent the plan, or holds it under this key."""
    return rows_of(HELD[given] if isinstance(given, str) else _opened(given), runs)


def _on_cluster(client: Any, plan: Plan, tasks: Sequence[Sequence[int]]) -> Generator[list[Row]]:
    """The rows of each task, made on a cluster of dask distributed: workers come and go.

    The plan is the result of a task of its own: it is sent to the scheduler once, handed from worker to worker, and,
    unlike scattered data, made again when all that had it are gone. A lost task is run again by dask. Where all workers
    die that try a task, dask may blame what waited there too: so its runs are tried at the end, one at a time, and one
    that kills its workers alone is a failed row.
    """
    from distributed import CancelledError, KilledWorker
    from distributed import as_completed as completed

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
        for future in completed(submit(tasks), loop=client.loop):
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
    _require_version(sender)
    return plan


def _require_version(sender: str) -> None:
    if sender != (own := version("ambid")):
        raise InputError(f"a worker has ambid {own}, and the plan is of {sender}; install the same everywhere")


def make_rows(runs: Sequence[int], plan: Plan) -> list[Row]:
    """The rows of one task, in a worker."""
    return rows_of(plan, runs)
