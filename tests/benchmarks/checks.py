"""Does `check` find what is wrong with a record, and leave right ones alone? Over the grid of `recorder_noise.py`.

    python tests/benchmarks/checks.py checks.jsonl --count 1000
    python tests/benchmarks/checks.py checks.jsonl --report

Each right record is checked, and once more with one fault: a y that is 5 % too large, all y 0.3 samples late, a y of
the other sign, two y exchanged. A fault counts that moves a parameter by three standard errors, or that no fit bears;
it is found by a finding that the right record does not have. It goes on where it stopped; no part of the tests.
"""

import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Record, Rig, check, identify
from ambid.errors import AmbidError
from benchmarks.grid import Row, options, rate_text, read_rows, run_all
from benchmarks.recorder_noise import made
from hidden.dirt import shifted

MOVED = 3.0
"""Standard errors by which a fault matters."""


def one_scaled(y: np.ndarray) -> np.ndarray:
    """The first y is 5 % too large."""
    return y * np.where(np.arange(y.shape[1]) == 0, 1.05, 1.0)


def all_late(y: np.ndarray) -> np.ndarray:
    """Every y is 0.3 samples late."""
    return shifted(y, 0.3)


def one_turned(y: np.ndarray) -> np.ndarray:
    """The first y has the other sign."""
    return y * np.where(np.arange(y.shape[1]) == 0, -1.0, 1.0)


def two_exchanged(y: np.ndarray) -> np.ndarray:
    """The first y stands for the last, and the last for the first."""
    order = np.arange(y.shape[1])
    order[[0, -1]] = order[[-1, 0]]
    return y[:, order]


FAULTS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    own.__name__: own for own in (one_scaled, all_late, one_turned, two_exchanged)
}

OF_DEGREE = ("one_scaled", "all_late")
"""Those that may be too small to matter."""


def run(index: int) -> Row:
    """What `check` says of one record, and of it with a fault."""
    rig, right, _ = made(index)
    kinds = [name for name in FAULTS if len(rig.axes) > 1 or name != "two_exchanged"]
    fault = kinds[index % len(kinds)]
    wrong = replace(right, y=FAULTS[fault](np.array(right.y)))
    said = [Counter(f"{own.severity} {own.code}" for own in check(rig, record).findings) for record in (right, wrong)]
    return {
        "fault": fault,
        "right": sorted(said[0]),
        "wrong": sorted((said[1] - said[0]).keys()),
        "moved": _moved(rig, right, wrong) if fault in OF_DEGREE else float("inf"),
    }


def _moved(rig: Rig, right: Record, wrong: Record) -> float:
    """By how many standard errors a fault of degree moves a parameter; infinite where it is lost, or nothing fits."""
    before = identify(rig, right).parameters
    try:
        after = identify(rig, wrong).parameters
    except AmbidError:
        return float("inf")
    moved = [
        float("inf") if after[name].value is None else abs(after[name].value - own.value) / own.std_error
        for name, own in before.items()
        if own.value is not None and own.std_error
    ]
    return max(moved, default=0.0)


def report(rows: list[Row]) -> None:
    """Right records with an error or a warning, and faults that are found."""
    for severity in ("error", "warning"):
        named = [[text for text in row["right"] if text.startswith(severity)] for row in rows]
        codes = Counter(text for own in named for text in own)
        print(f"right records with {severity}s: {rate_text(sum(map(bool, named)), len(rows))}  {dict(codes)}")
    for fault in FAULTS:
        own = [row for row in rows if row["fault"] == fault]
        matter = [row for row in own if row["moved"] > MOVED]
        found = [row for row in matter if row["wrong"]]
        print(
            f"{fault}: found {rate_text(len(found), len(matter))}; {len(own) - len(matter)} of {len(own)} move nothing"
        )


def main() -> None:
    """Run what is missing, or report."""
    parser = options(__doc__, workers=1)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=1000)
    given = parser.parse_args()
    if given.report:
        report(read_rows(given.out))
        return
    run_all(run, [(index,) for index in range(given.count)], given.out, given.workers)


if __name__ == "__main__":
    main()
