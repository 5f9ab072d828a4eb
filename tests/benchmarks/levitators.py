"""How often is the truth in the reported set, on levitators that nobody chose? One axis, slow coils, any excitation.

    python tests/benchmarks/levitators.py --machines 24 --out levitators.jsonl
    python tests/benchmarks/levitators.py --out levitators.jsonl --report --wrong

Machines are drawn at random (`hidden/levitators.py`). Every effect is as large as lifts the misfit of the base model
clearly above its bound, and at most to 3; what no physical size makes visible on a machine is left out. What its
true name cannot be distinguished from the diagnosis reports as a set or a family, right if the truth is in it.
Runs go on where the file ends; no part of it is a test.
"""

import sys
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import diagnose, identify
from ambid.errors import AmbidError
from benchmarks.grid import aligned, options, rate_text, read_rows, run_all
from benchmarks.rates import HEAD, is_right, rates
from hidden.bench import MachineFailure
from hidden.levitators import EFFECTS, Levitator, levitator

CLEAR, LARGE = 3.0, 3.0
"""Least excess of the misfit over that which its bound allows; largest misfit."""
SOUGHT = 7
"""Sizes that are tried."""
SHOWN = ("machine", "drive", "hidden", "verdict", "effects", "sets", "misfits", "error")


def sized(machine: Levitator, effect: str) -> dict | None:
    """Parameters of an effect that shows clearly; None where no physical size does."""
    law, x, most = EFFECTS[effect]
    low, high, best = 0.0, np.inf, None
    for _ in range(SOUGHT):
        try:
            found = identify(machine.rig, machine.record({effect: law(x, machine)}, 1))
            misfit, least = found.misfit, 1.0 + CLEAR * (found.misfit_bound - 1.0)
        except (MachineFailure, AmbidError):
            misfit, least = np.inf, 1.0
        if least < misfit < LARGE:
            return law(x, machine)
        if misfit < least:
            if x >= most:
                break
            low, x = x, min(most, 3.0 * x if np.isinf(high) else float(np.sqrt(x * high)))
        else:
            best = law(x, machine) if np.isfinite(misfit) else best
            high, x = x, x / 3.0 if low == 0.0 else float(np.sqrt(low * x))
    return best


def run(number: int, effect: str | None) -> dict[str, Any]:
    """One experiment and its diagnosis."""
    hidden = () if effect is None else (effect,)
    line: dict[str, Any] = {"machine": number, "hidden": list(hidden), "size": "clear"}
    try:
        machine = _machine(number)
        line |= {"drive": machine.drive, "rate": machine.rig.sample_rate, "coil": machine.rig.amplifier.time_constant}
        parameters = {name: sized(machine, name) for name in hidden}
        if None in parameters.values():
            return {**line, "verdict": "not visible"}
        train, kept_back = (machine.record(parameters, seed) for seed in (2, 3))
        begun = time.perf_counter()
        found = diagnose(machine.rig, train, validate=kept_back)
    except Exception as error:
        return {**line, "verdict": "error", "error": f"{type(error).__name__}: {error}"}
    return {
        **line,
        "parameters": parameters,
        "verdict": found.verdict,
        "effects": list(found.effects),
        "sets": found.ambiguous_sets,
        "misfits": [round(step.misfit, 3) for step in found.history],
        "seconds": round(time.perf_counter() - begun, 2),
    }


@lru_cache(maxsize=2)
def _machine(number: int) -> Levitator:
    return levitator(number)


def main() -> None:
    """Run what is missing, or report."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--machines", type=int, default=24)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--wrong", action="store_true", help="list what went wrong")
    given = parser.parse_args()
    if not (given.report or given.wrong):
        machines = range(given.first, given.first + given.machines)
        run_all(run, [(m, own) for m in machines for own in (None, *EFFECTS)], given.out, given.workers)
        return
    rows = read_rows(given.out)
    lines = [row for row in rows if row["verdict"] != "not visible"]
    print(f"{len(rows) - len(lines)} of {len(rows)} left out, too small to be seen")
    if given.report:
        print(aligned(HEAD, rates(lines)), end="\n\n")
        for drive in sorted({row["drive"] for row in lines}):
            own = [is_right(row) for row in lines if row["drive"] == drive]
            print(f"{drive:10s} {rate_text(sum(own), len(own))}")
    for line in lines if given.wrong else ():
        if not is_right(line):
            print({key: line[key] for key in SHOWN if key in line})


if __name__ == "__main__":
    main()
