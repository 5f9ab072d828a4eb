"""How often is something named where nothing is hidden? Short and long records, few and many channels.

    python tests/benchmarks/nulls.py --seeds 20 --out nulls.jsonl
    python tests/benchmarks/nulls.py --out nulls.jsonl --report

Runs go on where the file ends; no part of it is a test. Records are those of the independent simulator in
`tests/hidden`: a mass on one axis, and two spindles on four. A verdict other than `adequate` is false.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import diagnose, prbs
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS

MACHINES = {"levitator": ONE_AXIS, **BENCHES}
IMPLEMENTATIONS = ("analog", "digital")
ORDERS, PERIODS = (5, 6, 7, 8, 9), (4, 6, 8, 12)
HOLD = 2
"""Samples a chip, so that a period has 62 to 1022 samples."""
Job = tuple[str, str, int, int, int]


def jobs(seeds: int) -> list[Job]:
    """Machine, implementation, order of the PRBS, periods and seed of every run, seed by seed."""
    grid = product(range(seeds), MACHINES, IMPLEMENTATIONS, ORDERS, PERIODS)
    return [(machine, kind, order, periods, seed) for seed, machine, kind, order, periods in grid]


def run(job: Job) -> dict[str, Any]:
    """Diagnose one record."""
    machine, implementation, order, periods, seed = job
    bench = MACHINES[machine]
    controller = bench.rig.controller.model_copy(update={"implementation": implementation})
    rig = bench.rig.replace(controller=controller)
    i_e = prbs(order, amplitude=bench.amplitude, hold=HOLD, axes=len(rig.axes), periods=periods, seed=seed)
    begun = time.perf_counter()
    found = diagnose(rig, measured(rig, i_e, {}, seed=seed, **bench.truth))
    first = found.history[0] if found.history else None
    return {
        "job": list(job),
        "verdict": found.verdict,
        "effects": list(found.effects),
        "misfit": None if first is None else first.misfit,
        "p_value": None if first is None else min(c.p_value for c in first.ranking.candidates),
        "candidates": 0 if first is None else len(first.ranking.candidates),
        "notes": list(found.notes),
        "seconds": time.perf_counter() - begun,
    }


def report(rows: list[dict[str, Any]]) -> None:
    """False verdicts by machine and length, and why."""
    by_cell: dict[tuple[str, str, int, int], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        machine, implementation, order, periods, _ = row["job"]
        by_cell[machine, implementation, order, periods].append(row)
    line = "{:10s} {:10s} {:>8} {:>8} {:>5} {:>6}  {:18s} {}"
    print(line.format("machine", "controller", "samples", "periods", "runs", "false", "J/dof", "verdicts"))
    for (machine, implementation, order, periods), own in sorted(by_cell.items()):
        wrong = [row for row in own if row["verdict"] != "adequate"]
        misfits = [row["misfit"] for row in own if row["misfit"] is not None]
        spread = f"{np.mean(misfits):.3f} +- {np.std(misfits):.3f}" if misfits else ""
        why = Counter(row["verdict"] + (f" {'+'.join(row['effects'])}" if row["effects"] else "") for row in wrong)
        told = ", ".join(f"{count} {name}" for name, count in why.most_common(3))
        samples = (2**order - 1) * HOLD
        print(line.format(machine, implementation, samples, periods, len(own), len(wrong), spread, told))
    total = sum(row["verdict"] != "adequate" for row in rows)
    print(f"{total} false verdicts in {len(rows)} records, {100 * total / len(rows):.1f} %")


def main() -> None:
    """Run what is missing in the file, or report what it holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--machine", choices=MACHINES, action="append")
    parser.add_argument("--report", action="store_true")
    given = parser.parse_args()
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    if given.report:
        report(rows)
        return
    done = {tuple(row["job"]) for row in rows}
    wanted = [j for j in jobs(given.seeds) if j not in done and j[0] in (given.machine or MACHINES)]
    with ProcessPoolExecutor() as pool, given.out.open("a") as file:
        for future in as_completed([pool.submit(run, job) for job in wanted]):
            file.write(json.dumps(future.result()) + "\n")
            file.flush()


if __name__ == "__main__":
    main()
