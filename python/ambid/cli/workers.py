"""Who makes the runs of `monte-carlo`: this process, others of this machine, or a cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.util import find_spec
from threading import Thread
from typing import Any

import ambid
from ambid.errors import InputError

PATIENCE = 5.0
"""Seconds in which a scheduler answers; one that is there takes far less than one."""
MOST_WORKERS = 1000
"""Processes of one machine: beyond its cores they only take memory, some hundred megabytes each."""


def workers_of(plan: ambid.Plan, workers: int, cluster: str | None) -> AbstractContextManager[Any]:
    """The executor that the options ask for; nothing where the runs are made here.

    Raises
    ------
    InputError
        If they contradict each other, or no scheduler answers.
    """
    if not 1 <= workers <= MOST_WORKERS:
        raise InputError(f"--workers {workers}: expected 1 to {MOST_WORKERS}")
    if cluster is not None and workers > 1:
        raise InputError(f"--workers {workers}, --cluster {cluster}: a cluster has workers of its own; leave one out")
    if cluster is not None:
        return _cluster(cluster)
    return nullcontext() if workers == 1 else _pool(plan, workers)


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    if find_spec("distributed") is None:
        raise InputError(f"--cluster {address}: needs the package distributed: pip install 'ambid[cluster]'")
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--cluster {address}: no scheduler answers ({error}); expected an address such as tcp://host:8786, "
            "as `dask scheduler` prints it"
        ) from None
    with client:
        yield client


@contextmanager
def _pool(plan: ambid.Plan, workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that make runs, each in one thread; when they are no longer wanted they end at once."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _as_worker, (plan,))
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for own in set(multiprocessing.active_children()) - others:
            own.terminate()


def _as_worker(plan: ambid.Plan) -> None:
    os.environ["RAYON_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one that waits for this process ends it
    Thread(target=_end_with_parent, daemon=True).start()
    ambid.hold_plan(plan)


def _end_with_parent() -> None:
    """A parent that was killed leaves nobody to end its workers, which would wait for tasks for ever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)
