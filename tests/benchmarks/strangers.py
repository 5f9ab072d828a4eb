"""How often is the truth in the reported set, on machines that nobody chose? What is hidden has a name, or has none.

    python tests/benchmarks/strangers.py --machines 12 --out strangers.jsonl
    python tests/benchmarks/strangers.py --machines 12 --together 2 3 --draws 6 --out strangers.jsonl
    python tests/benchmarks/strangers.py --out strangers.jsonl --report --wrong

Machines are drawn at random (`hidden/strangers.py`), every effect is sized for its machine as in `rates.py`, and each
record is made by the independent simulator. What no physical size makes visible on a machine is left out. With
`--together`, effects of the catalogue are drawn at random, so many at a time, and so many such draws a machine.
Runs go on where the file ends; no part of it is a test.
"""

import sys
import time
from collections import defaultdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from ambid import diagnose
from benchmarks.grid import aligned, options, read_rows, run_all
from benchmarks.rates import HEAD, is_right, rates
from hidden.experiment import experiment_on
from hidden.families import Bench
from hidden.physics import CATALOGUE, OUTSIDE
from hidden.sizes import TARGETS, find
from hidden.strangers import stranger

SEEN = 0.5
"""Part of the score that was asked for, below which an effect is not of that size."""
SHOWN = ("machine", "hidden", "size", "verdict", "effects", "sets", "misfits", "ranking", "notes", "error")


def run(machine: int, hidden: tuple[str, ...], size: str) -> dict[str, Any]:
    """One experiment and its diagnosis."""
    line: dict[str, Any] = {"machine": machine, "hidden": list(hidden), "size": size}
    try:
        bench = _bench(machine)
        found = {name: find(name, TARGETS[size], bench) for name in hidden}
        rig, train, validate, truth = experiment_on(bench, found, machine)
        smallest = min((own.score for own in found.values()), default=0.0)
        line |= {"score": smallest, "parameters": truth.parameters}
        begun = time.perf_counter()
        diagnosis = diagnose(rig, train, validate=validate)
    except Exception as error:
        return {**line, "verdict": "error", "error": f"{type(error).__name__}: {error}"}
    first = diagnosis.history[0] if diagnosis.history else None
    return {
        **line,
        "verdict": diagnosis.verdict,
        "effects": list(diagnosis.effects),
        "sets": diagnosis.ambiguous_sets,
        "misfits": [round(step.misfit, 4) for step in diagnosis.history],
        "ranking": [[c.effect.name, round(c.score, 1)] for c in first.ranking.candidates[:4]] if first else [],
        "notes": list(diagnosis.notes),
        "seconds": round(time.perf_counter() - begun, 2),
    }


@lru_cache(maxsize=2)
def _bench(machine: int) -> Bench:
    return stranger(machine)


def drawn(machine: int, count: int, draws: int) -> list[tuple[str, ...]]:
    """So many effects of the catalogue at a time, as chance has it; each draw holds for more draws too."""
    random = np.random.default_rng([machine, 43, count])
    found = [sorted(random.choice(len(CATALOGUE), count, replace=False)) for _ in range(draws)]
    return list(dict.fromkeys(tuple(list(CATALOGUE)[k] for k in own) for own in found))


def shown(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those whose effects are as large as they should be, or nearly."""
    return [x for x in lines if x["verdict"] == "error" or not x["hidden"] or x["score"] > SEEN * TARGETS[x["size"]]]


def report(lines: list[dict[str, Any]]) -> None:
    """Tables of the rates, by size and by machine."""
    print(aligned(HEAD, rates(lines)), end="\n\n")
    by_machine = defaultdict(list)
    for line in lines:
        by_machine[line["machine"]].append(is_right(line))
    rows = [[str(machine), f"{sum(right)}/{len(right)}"] for machine, right in sorted(by_machine.items())]
    print(aligned(("machine", "right"), rows))


def main() -> None:
    """Run what is missing, or report."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--machines", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sizes", nargs="*", choices=list(TARGETS), default=["clear"])
    parser.add_argument("--together", nargs="*", type=int, default=[], help="effects at a time, instead of each alone")
    parser.add_argument("--draws", type=int, default=6)
    parser.add_argument("--wrong", action="store_true", help="list what went wrong")
    given = parser.parse_args()
    if not (given.report or given.wrong):
        each = [(), *((name,) for name in (*CATALOGUE, *OUTSIDE))]
        jobs = []
        for m in range(given.first, given.first + given.machines):
            names = [own for count in given.together for own in drawn(m, count, given.draws)] or each
            jobs += [(m, own, size) for size in given.sizes for own in names]
        run_all(run, jobs, given.out, given.workers)
        return
    rows = read_rows(given.out)
    lines = shown(rows)
    print(f"{len(rows) - len(lines)} of {len(rows)} left out, too small to be seen")
    if given.report:
        report(lines)
    for line in lines if given.wrong else ():
        if not is_right(line):
            print({key: line[key] for key in SHOWN if key in line})


if __name__ == "__main__":
    main()
