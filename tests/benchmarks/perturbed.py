"""Does a rounding change what is found? Inputs are moved by a relative 1e-12, and what is said must stay.

    python tests/benchmarks/perturbed.py --identify 300 --diagnose 150 --out perturbed.jsonl
    python tests/benchmarks/perturbed.py --data DATA --out perturbed.jsonl
    python tests/benchmarks/perturbed.py --out perturbed.jsonl --report

Every number of the records' signals and every physical value of the rig file that no other has to fit is multiplied by
1 + 1e-12 u, u uniform in -1 .. 1. Of a fit its status, what it does not determine, whether it is adequate and the
likeliest effect are compared; of a diagnosis its verdict, what it names and what it would name as well. Wanted is that
nothing changes in 99.5 % of all cases. Cases are drawn from the benches of `tests/hidden`, from levitators and machines
that nobody chose, from records in which nothing is hidden, and from a folder of data (``cases/*``), if one is given.
Runs go on where the file ends; no part of it is a test.
"""

import sys
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import FrequencyResponse, Record, Rig, diagnose, identify, rank
from benchmarks.grid import Row, options, rate_text, read_rows, run_all
from hidden.experiment import KINDS, experiment, experiment_on
from hidden.families import FAMILIES
from hidden.levitators import EFFECTS, levitator
from hidden.null_cells import made
from hidden.strangers import stranger

Case = tuple[Rig, list[Record], list[Record]]
SHARE = 1e-12
WANTED = 0.995
EXACT = {"position", "sensor_position", "tilt", "sample_rate", "delay_samples"}
"""Values of a rig file that others have to fit."""
SIGNALS = ("i_e", "y", "i_c", "i_ref", "r")
STRANGERS, LEVITATORS, NULLS = 40, 40, 2000
"""Numbers that machines and records are drawn from."""


def case(kind: str, what: str, number: int, data: str | None) -> Case:
    """Rig, records to fit and records to validate with."""
    if kind == "data":
        folder = Path(data or "") / "cases" / what
        rig = Rig.load(folder / "rig.toml")
        train, validate = (sorted(folder.glob(f"{part}*")) for part in ("train", "validate"))
        return rig, [Record.load(path, rig) for path in train], [Record.load(path, rig) for path in validate]
    if kind == "null":
        rig, record = made(number)
        return rig, [record], []
    if kind == "levitator":
        machine = levitator(number)
        law, size, _ = EFFECTS.get(what, (None, 0.0, 0.0))
        hidden = {} if law is None else {what: law(size, machine)}
        return machine.rig, [machine.record(hidden, 2)], [machine.record(hidden, 3)]
    if kind == "stranger":
        return experiment_on(stranger(number), {}, number)[:3]
    return experiment(what or None, "clear", number, kind=kind)[:3]


def perturbed(own: Case, seed: int) -> Case:
    """The same case, every number moved a little."""
    random = np.random.default_rng([seed, 47])
    rig, *parts = own
    moved = rig.replace(
        bearings=[_spec(bearing, random) for bearing in rig.bearings],
        actuator=_spec(rig.actuator, random),
        amplifier=_spec(rig.amplifier, random),
        controller=_spec(rig.controller, random),
    )
    train, validate = ([_record(record, random) for record in part] for part in parts)
    return moved, train, validate


def _spec(spec, random: np.random.Generator):
    moved = {}
    for name in type(spec).model_fields:
        value = getattr(spec, name)
        if name not in EXACT and isinstance(value, float):
            moved[name] = float(_near(value, random))
        elif name not in EXACT and isinstance(value, tuple) and all(isinstance(one, float) for one in value):
            moved[name] = tuple(float(one) for one in _near(np.array(value), random))
    return spec.model_copy(update=moved)


def _record(record: Record, random: np.random.Generator) -> Record:
    if isinstance(record, FrequencyResponse):
        return record
    signals = {name: getattr(record, name) for name in SIGNALS}
    return replace(record, **{name: _near(own, random) for name, own in signals.items() if own is not None})


def _near(value, random: np.random.Generator):
    return value * (1.0 + SHARE * random.uniform(-1.0, 1.0, np.shape(value)))


def fitted(own: Case) -> Row:
    """What a fit says, and the likeliest effect beside it."""
    rig, train, _ = own
    found = identify(rig, train)
    candidates = rank(found.comparison).candidates if found.model.is_stable else ()
    return {
        "status": found.status,
        "undetermined": sorted({name for direction in found.directions for name in direction}),
        "adequate": found.is_adequate,
        "likeliest": candidates[0].effect.name if candidates else None,
    }


def diagnosed(own: Case) -> Row:
    """What a diagnosis says."""
    rig, train, validate = own
    found = diagnose(rig, train, validate=validate or None)
    sets = sorted(map(sorted, found.ambiguous_sets))
    return {"verdict": found.verdict, "effects": sorted(found.effects), "sets": sets}


JOBS = {"identify": fitted, "diagnose": diagnosed}


def run(job: str, kind: str, what: str, number: int, data: str | None = None) -> Row:
    """One case, as it is and moved."""
    try:
        own = case(kind, what, number, data)
    except Exception as error:  # a machine that is not stable with this effect
        return {"error": f"{type(error).__name__}: {error}"}
    before, after = (_outcome(JOBS[job], one) for one in (own, perturbed(own, number)))
    return {"same": before == after, "before": before, "after": after}


def _outcome(job, own: Case) -> Row:
    try:
        return job(own)
    except Exception as error:
        return {"refused": type(error).__name__}


def jobs(job: str, count: int) -> list[tuple]:
    """So many cases, drawn evenly from every kind."""
    random = np.random.default_rng(len(job))
    kinds = {
        **{kind: list(product(["", *FAMILIES], range(3))) for kind in KINDS},
        "levitator": list(product(["", *EFFECTS], range(LEVITATORS))),
        "stranger": list(product([""], range(STRANGERS))),
        "null": list(product([""], range(NULLS))),
    }
    drawn = [
        [(job, kind, *cells[k]) for k in random.permutation(len(cells))[: -(-count // len(kinds))]]
        for kind, cells in kinds.items()
    ]
    return [own for some in zip(*drawn, strict=True) for own in some][:count]


def report(rows: list[Row]) -> None:
    """Rates with their counts, and every case that changed."""
    for job in JOBS:
        own = [row for row in rows if row["key"][0] == job and "same" in row]
        same = sum(row["same"] for row in own)
        missing = sum(row["key"][0] == job and "error" in row for row in rows)
        print(f"{job}: unchanged {rate_text(same, len(own))}, wanted {100 * WANTED:g} %; {missing} could not be made")
        print(f"  by kind: {dict(Counter(row['key'][1] for row in own if not row['same']))} changed")
    for row in rows:
        if not row.get("same", True):
            pairs = {name: (row["before"].get(name), row["after"].get(name)) for name in row["before"] | row["after"]}
            changed = [f"{name}: {old} -> {new}" for name, (old, new) in sorted(pairs.items()) if old != new]
            print(f"{' '.join(map(str, row['key']))}: {', '.join(changed)}")


def main() -> None:
    """Run what is missing in the file, and report what it holds."""
    parser = options(__doc__, workers=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--identify", type=int, default=0, help="cases that are fitted and ranked")
    parser.add_argument("--diagnose", type=int, default=0, help="cases that are diagnosed")
    parser.add_argument("--data", type=Path, help="folder with cases/*")
    given = parser.parse_args()
    if not given.report:
        todo = [own for job in JOBS for own in jobs(job, getattr(given, job))]
        if given.data is not None:
            folders = sorted(path.parent.name for path in (given.data / "cases").glob("*/rig.toml"))
            todo += [(job, "data", name, 0, str(given.data)) for job in JOBS for name in folders]
        run_all(run, todo, given.out, given.workers)
    report(read_rows(given.out))


if __name__ == "__main__":
    main()
