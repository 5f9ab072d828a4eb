"""What a task costs a cluster of dask beside its runs, how large a graph may be, and what 100 workers would give.

Run from `tests` with ``python benchmarks/cluster.py``; no part of the tests. The cluster is two processes of this
machine, and the scheduler runs in the process of the client: what both of them need for a task is measured together,
by the clock of the processor. What is said of 100 workers is computed from that, not measured.
"""

import argparse
import pickle
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from distributed import Client, LocalCluster
from speed import PERIOD, excitation, rigid

from ambid.monte_carlo import Plan, executors, procedure, run_monte_carlo
from ambid.monte_carlo.executors import made_by
from ambid.monte_carlo.runs import Row, failed_row, rows_of
from virtual import VirtualBench

WORKERS = 100
"""For which the rate is computed."""


def nothing(runs: list[int], plan: Plan) -> list[Row]:
    """Rows as large as those of identifications, for no work."""
    return [failed_row(plan, run, "") for run in runs]


def instant(runs: list[int], plan: Plan) -> list[Row]:
    """No rows: what remains is what the task itself takes."""
    return []


def overhead(
    job: Callable[[], object], tasks: int, work: Callable[[list[int], Plan], list[Row]]
) -> tuple[float, float]:
    """Seconds a task: of the processor for client and scheduler, and by wall."""
    usual, executors.make_rows = executors.make_rows, work
    wall, busy = time.perf_counter(), time.process_time()
    job()
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    executors.make_rows = usual
    return busy / tasks, wall / tasks


def seconds_a_run(plan: Plan, runs: int) -> float:
    """Of one processor, as a worker of one thread takes them."""
    rows_of(plan, range(procedure.BATCH))
    busy = time.process_time()
    for first in range(0, runs, procedure.BATCH):
        rows_of(plan, range(first, first + procedure.BATCH))
    return (time.process_time() - busy) / runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=2000)
    parser.add_argument("--largest", type=int, default=20_000, help="Tasks of the largest graph.")
    parser.add_argument("--runs", type=int, default=32, help="Identifications that are timed.")
    given = parser.parse_args()
    plan = Plan(rigid(VirtualBench().rig()), np.asarray(excitation(4 * PERIOD)))
    print(f"plan: {len(pickle.dumps(plan)) / 1e6:.2f} MB, sent once; {procedure.BATCH} runs a task")
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as two,
        Client(two, set_as_default=False) as client,
    ):
        run_monte_carlo(plan, 10 * procedure.BATCH, executor=client)  # workers begin with their imports
        with TemporaryDirectory() as folder:
            out, runs = Path(folder) / "runs.parquet", given.tasks * procedure.BATCH
            busy, wall = overhead(lambda: run_monte_carlo(plan, runs, out=out, executor=client), given.tasks, nothing)
        print(
            f"{given.tasks:7d} tasks, written: {1e3 * busy:.2f} ms of the processor, {1e3 * wall:.2f} ms by wall, each"
        )
        graph = [[run] for run in range(given.largest)]
        empty, wall = overhead(lambda: list(made_by(client, plan, graph)), given.largest, instant)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(
            f"{given.largest:7d} tasks, no rows: {1e3 * empty:.2f} ms of the processor, {1e3 * wall:.2f} ms by wall, "
            f"each; at most {peak:.2f} GB for client and scheduler"
        )
    run = seconds_a_run(plan, given.runs)
    most, asked = procedure.BATCH / busy, WORKERS / run
    print(f"identification: {1e3 * run:.0f} ms of the processor a run, {1.0 / run:.1f} runs/s on one")
    print(
        f"computed, not measured: {WORKERS} workers of one such processor each could make {asked:.0f} runs/s;\n"
        f"client and scheduler, together on one such processor, can hand out, take back and write {most:.0f} runs/s.\n"
        f"The lesser is what they would give: {min(asked, most):.0f} runs/s, {min(asked, most) * run:.0f} times one"
    )


if __name__ == "__main__":
    main()
