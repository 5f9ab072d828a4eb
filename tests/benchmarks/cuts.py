"""Does a record show the same wherever it begins and ends? Random cuts of records with a known answer.

    python tests/benchmarks/cuts.py CASES --cuts 100 --out cuts.jsonl
    python tests/benchmarks/cuts.py CASES --out cuts.jsonl --report --table cuts.md

CASES is a folder of cases (rig.toml and train.* each) with `answers.json`, of which those count that are named by
`--case`. The model is right: the linear one with the hidden effects of the answer. To these comes a pair of records of
one turning machine at two speeds, from the independent simulator in `tests/hidden`, cut apart and judged together.
Cuts of a record share its noise, so that the rates over its cuts are no surer than those over a few records; 100 cuts
a source by default, at any start and of any length. Runs go on where the file ends; no part of it is a test.
"""

import json
import sys
from functools import cache, partial
from pathlib import Path
from zlib import crc32

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Model, Record, Rig
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

PAIR = "two speeds"
PAIR_SPEEDS = (100.0, 300.0)
SHORTEST = 600
"""Samples of the shortest cut."""
Source = tuple[Model, list[Record], dict[str, float]]


def source(folder: Path, name: str) -> Source:
    """Right model, whole records and true values."""
    return _pair() if name == PAIR else _case(folder, name)


@cache
def _case(folder: Path, name: str) -> Source:
    answer = json.loads((folder / "answers.json").read_text())[name]
    rig = Rig.load(folder / name / "rig.toml")
    model = Model(rig)
    for effect in answer["effects"]:
        model = model.add(effect)
    record = Record.load(next((folder / name).glob("train.*")), rig)
    return model, [record], truth_of(rig, answer["K_i"], answer["K_s"], answer["tau_e"])


@cache
def _pair() -> Source:
    bench = BENCHES["bench"]
    slow, fast = (bench.rig.replace(name=f"{speed:g} rad/s", speed=speed) for speed in PAIR_SPEEDS)
    records = [
        measured(rig, bench.excitation(bench.amplitude, seed), {}, seed=seed, **bench.truth, **bench.noise)
        for seed, rig in ((1, slow), (2, fast))
    ]
    return Model(slow), [records[0], records[1].at(fast)], truth_of(slow, **bench.truth)


def run(folder: Path, name: str, number: int) -> Row:
    """Identify the whole records (number 0), or a cut of each."""
    model, records, truth = source(folder, name)
    places = [(0, record.samples) for record in records]
    if number:
        random = np.random.default_rng([number, crc32(name.encode())])
        places = [at_will(record.samples, SHORTEST, random) for record in records]
        records = [
            cut(record, *place, model.rig if record.point is None else record.point)
            for record, place in zip(records, places, strict=True)
        ]
    periods = [record.periods for record in records]
    return {"places": places, "periods": periods, **judged(model, records, truth)}


def tables(rows: list[Row]) -> tuple[list[list[str]], list[list[str]]]:
    """Coverage and spread of whole records and of cuts, and their J/dof, by source and by length."""
    whole, pieces = ([row for row in rows if bool(row["key"][1]) is is_cut] for is_cut in (False, True))
    groups = {"all whole": whole, "all cuts": pieces}
    for name in dict.fromkeys(row["key"][0] for row in rows):
        groups |= {
            f"{name}, {kind}": [row for row in chosen if row["key"][0] == name]
            for kind, chosen in (("whole", whole), ("cuts", pieces))
        }
    for title, low, high in (("below 1500", 0, 1500), ("1500 .. 5000", 1500, 5000), ("above 5000", 5000, 10**9)):
        groups[f"cuts {title} samples"] = [row for row in pieces if low <= min(n for _, n in row["places"]) < high]
    spreads = [NORMAL_LINE]
    for name, own in groups.items():
        lines = spread_rows(name, own)
        spreads += lines if name == "all cuts" else [line for line in lines if line[1] == "all"]
    return spreads, [misfit_line(name, own) for name, own in groups.items() if own]


def main() -> None:
    """Run what is missing in the file, or report what it holds."""
    parser = options(__doc__, workers=2)
    parser.add_argument("cases", type=Path)
    parser.add_argument("--case", nargs="*", default=["01", "03", "06"], help="what the names of cases begin with")
    parser.add_argument("--cuts", type=int, default=100, help="of each source")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if not (given.report or given.table):
        answers = json.loads((given.cases / "answers.json").read_text())
        names = [name for name in answers if name.startswith(tuple(given.case))]
        jobs = [(name, number) for number in range(given.cuts + 1) for name in (*names, PAIR)]
        run_all(partial(run, given.cases), jobs, given.out, given.workers)
        return
    spreads, misfits = tables(read_rows(given.out))
    if given.report:
        print(aligned(HEAD, spreads), end="\n\n")
        print(aligned(MISFIT_HEAD, misfits))
    if given.table:
        given.table.write_text("\n".join((markdown(HEAD, spreads), markdown(MISFIT_HEAD, misfits))))


if __name__ == "__main__":
    main()
