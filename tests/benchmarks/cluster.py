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
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from distributed import Client, LocalCluster
from speed import PERIOD, excitation, rigid

from ambid.monte_carlo import Plan, cluster, procedure
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


def overhead(client: Client, plan: Plan, tasks: int, work) -> tuple[float, float]:
    """Seconds a task: of the processor for client and scheduler, and between first and last."""
    usual, cluster._rows = cluster._rows, work
    batches = [range(first, first + procedure.BATCH) for first in range(0, tasks * procedure.BATCH, procedure.BATCH)]
    wall, busy = time.perf_counter(), time.process_time()
    count = sum(1 for _ in cluster.made_on_cluster(client, plan, batches))
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    cluster._rows = usual
    assert count == tasks
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
    parser.add_argument("--largest", type=int, default=100_000, help="Tasks of the largest graph.")
    parser.add_argument("--runs", type=int, default=32, help="Identifications that are timed.")
    given = parser.parse_args()
    plan = Plan(rigid(VirtualBench().rig()), np.asarray(excitation(4 * PERIOD)))
    print(f"plan: {len(pickle.dumps(plan)) / 1e6:.2f} MB, sent once; {procedure.BATCH} runs a task")
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as two,
        Client(two, set_as_default=False) as client,
    ):
        overhead(client, plan, 100, nothing)
        busy, wall = overhead(client, plan, given.tasks, nothing)
        print(
            f"{given.tasks:7d} tasks with rows: {1e3 * busy:.2f} ms of the processor, {1e3 * wall:.2f} ms by wall, each"
        )
        empty, wall = overhead(client, plan, given.largest, instant)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(
            f"{given.largest:7d} tasks without: {1e3 * empty:.2f} ms of the processor, {1e3 * wall:.2f} ms by wall, "
            f"each; at most {peak:.2f} GB for client and scheduler"
        )
    run = seconds_a_run(plan, given.runs)
    most, asked = procedure.BATCH / busy, WORKERS / run
    print(f"identification: {1e3 * run:.0f} ms of the processor a run, {1.0 / run:.1f} runs/s on one")
    print(
        f"computed, not measured: {WORKERS} workers of one such processor each could make {asked:.0f} runs/s; client\n"
        f"and scheduler, together on one such processor, can hand out and take back {most:.0f} runs/s. Of these two the\n"
        f"lesser is what they would give: {min(asked, most):.0f} runs/s, {min(asked, most) * run:.0f} times one processor"
    )


if __name__ == "__main__":
    main()
