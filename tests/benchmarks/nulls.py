"""How often is something named where nothing is hidden? Over machines, lengths, excitations, dampings and noises.

    python tests/benchmarks/nulls.py --records 2000 --out nulls.jsonl
    python tests/benchmarks/nulls.py --out nulls.jsonl --report --picture nulls.png --table nulls.md

Runs go on where the file ends; no part of it is a test. Records are those of the independent simulator in
`tests/hidden`: a mass on one axis, two spindles on four, long shafts on eight and sixteen. The sample over all levels
is that of `hidden/null_cells.py`. False is a verdict that claims something: `explained`, `ambiguous` or
`none_of_the_candidates`; `not_informative` claims nothing and is counted apart, as are runs that end with an error.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import diagnose
from benchmarks.grid import Row, options, read_rows, run_all
from benchmarks.null_report import picture, report, table
from hidden.null_cells import described, made


def run(index: int) -> Row:
    """Diagnose one record."""
    cell, begun = described(index), time.perf_counter()
    row: Row = {"cell": cell}
    try:
        rig, record = made(index)
        row |= {"samples": record.samples, "period": record.period, "making": time.perf_counter() - begun}
        begun = time.perf_counter()
        found = diagnose(rig, record)
    except Exception as error:  # a gate that refuses a good record, too
        return {**row, "verdict": "error", "error": f"{type(error).__name__}: {error}", "effects": [], "p_values": {}}
    seconds = time.perf_counter() - begun
    first = found.history[0] if found.history else None
    candidates = () if first is None else first.ranking.candidates
    p_values = {c.effect.name: _finite(c.p_value) for c in candidates}
    shown = [value for value in p_values.values() if value is not None]
    notes = [*found.notes]
    named = {*found.effects, *(name for names in found.ambiguous_sets for name in names)}
    return {
        **row,
        "verdict": found.verdict,
        "effects": list(found.effects),
        "sets": found.ambiguous_sets,
        "misfit": None if first is None else _finite(first.misfit),
        "dof": _freedom(first, cell, record.samples),
        "p_value": min(shown, default=None),
        "candidates": len(candidates),
        "p_values": p_values,
        "tone": "periodic_disturbance" in named or any("a tone at" in note for note in notes),
        "drift": any("change during" in note for note in notes),
        "notes": notes,
        "seconds": seconds,
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def _freedom(first, cell: Row, samples: int) -> float:
    """What the engine says, or channels times samples per period (of all samples, where none repeats)."""
    shown = getattr(first, "dof", None)
    if shown is not None:
        return float(shown)
    channels = cell["nominal"] / ((2 ** cell["order"] - 1) * cell["hold"])
    return float(cell["nominal"] if cell["periods"] else channels * samples)


def main() -> None:
    """Run what is missing in the file, or report what it holds."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--records", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="number of the first record")
    parser.add_argument("--periods", type=int, help="only records of so many periods; 0: the excitation never repeats")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if not (given.report or given.picture or given.table):
        numbers = range(given.first, given.first + given.records)
        jobs = [(index,) for index in numbers if given.periods in (None, described(index)["periods"])]
        run_all(run, jobs, given.out, given.workers)
        return
    rows = read_rows(given.out)
    if given.report:
        report(rows)
    if given.picture:
        picture(rows, given.picture)
    if given.table:
        given.table.write_text(table(rows))


if __name__ == "__main__":
    main()
