"""Do the 95 % intervals hold the truth 95 % of the time? Two-bearing records of many seeds, whole and cut at will.

    python tests/benchmarks/coverage.py --seeds 600 --out coverage.jsonl
    python tests/benchmarks/coverage.py --out coverage.jsonl --report --table coverage.md

Runs go on where the file ends; no part of it is a test. The model is right: the linear one where nothing is hidden, and
with the effect in it where the independent simulator of `tests/hidden` hides one, of a clear size. Intervals of one
record belong to one noise: the interval of the rate over all parameters is narrower than it should be.
"""

import sys
from functools import cache
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Model, prbs
from benchmarks.grid import Row, aligned, markdown, options, read_rows, run_all
from benchmarks.intervals import (
    HEAD,
    MISFIT_HEAD,
    NORMAL_LINE,
    at_will,
    cut,
    judged,
    misfit_line,
    spread_rows,
    truth_of,
)
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.sizes import sized

BENCH = BENCHES["bench"]
HIDDEN = {"nothing": {}, "sensor_lag": {"time_constant": "tau"}, "loop_delay": {"delay": "seconds"}}
"""What is hidden, and by which name of the simulator its parameters go."""
PIECES = ("whole", "cut")
ORDER, HOLD, COUNT = 9, 5, 4
SHORTEST = 1500
"""Samples of the shortest cut, of 10 220 of the whole record with its four periods."""


@cache
def _model(hidden: str) -> Model:
    return Model(BENCH.rig) if hidden == "nothing" else Model(BENCH.rig).add(hidden)


def run(hidden: str, piece: str, seed: int) -> Row:
    """Identify one record, or a piece of it."""
    physics = {} if hidden == "nothing" else {hidden: sized(hidden, "clear").parameters}
    axes = len(BENCH.rig.axes)
    i_e = prbs(ORDER, amplitude=BENCH.amplitude, hold=HOLD, axes=axes, periods=COUNT, seed=seed)
    noise = seed + 10**6 * list(HIDDEN).index(hidden)
    record = measured(BENCH.rig, i_e, physics, seed=noise, **BENCH.truth, **BENCH.noise)
    start, length = 0, record.samples
    if piece == "cut":
        start, length = at_will(record.samples, SHORTEST, np.random.default_rng([seed, 2]))
        record = cut(record, start, length, BENCH.rig)
    truth = truth_of(BENCH.rig, **BENCH.truth)
    truth |= {f"{hidden}.{own}": physics[hidden][name] for own, name in HIDDEN[hidden].items()}
    return {"start": start, "length": length, **judged(_model(hidden), [record], truth)}


def tables(rows: list[Row]) -> tuple[list[list[str]], list[list[str]]]:
    """Coverage and spread of every parameter, and J/dof."""
    spreads, misfits = [NORMAL_LINE], []
    for hidden, piece in product(HIDDEN, PIECES):
        own = [row for row in rows if row["key"][:2] == [hidden, piece]]
        if own:
            spreads += spread_rows(f"{hidden}, {piece}", own)
            misfits.append(misfit_line(f"{hidden}, {piece}", own))
    for piece in PIECES:
        own = [row for row in rows if row["key"][1] == piece]
        spreads += [line for line in spread_rows(f"any, {piece}", own) if line[1] == "all"]
    return spreads, misfits


def main() -> None:
    """Run what is missing in the file, or report what it holds."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=600)
    parser.add_argument("--hidden", nargs="*", choices=HIDDEN, default=list(HIDDEN))
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if not (given.report or given.table):
        jobs = [(hidden, piece, seed) for seed in range(given.seeds) for hidden in given.hidden for piece in PIECES]
        run_all(run, jobs, given.out, given.workers)
        return
    spreads, misfits = tables(read_rows(given.out))
    if given.report:
        print(aligned(HEAD, spreads), end="\n\n")
        print(aligned(MISFIT_HEAD, misfits))
    if given.table:
        given.table.write_text("\n".join((markdown(HEAD, spreads), markdown(MISFIT_HEAD, misfits))))


if __name__ == "__main__":
    main()
