"""Frequency responses made from half of a record, beside another one in time: the same names, the same values?

    python tests/benchmarks/responses.py --out responses.jsonl --cases ../shared/cases
    python tests/benchmarks/responses.py --out responses.jsonl --report --table responses.md

A spindle on four axes that are excited together, with nothing hidden, with a delay of the loop and with a seal; and,
with `--cases`, measured records with a known answer. The response is read back from .mat, from .csv, and from a .csv
with nothing but std; the record in time is the other half, or the other file. Runs go on where the file ends; no part
of it is a test.
"""

import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Diagnosis, FrequencyResponse, Record, Rig, diagnose
from benchmarks.grid import NORMAL_95, Row, aligned, markdown, options, rate_text, read_rows, run_all
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.sizes import sized

HIDDEN = ("", "loop_delay", "seal_forces")
MEASURED = {"01-nothing-missing": "", "03-loop-delay": "loop_delay", "06-seal": "seal_forces"}
FORMS = (".mat", ".csv", "std alone")
HEAD = (
    "records",
    "hidden",
    "read from",
    "runs",
    "wrong name",
    "right name",
    "same as in time",
    "intervals that hold the truth",
    "J/dof, its rms about 1",
    "farthest from truth",
    "farthest from record",
)


def run(cases: Path | None, source: str, hidden: str, number: int) -> Row:
    """Diagnose a record in time, and half of another one as a response in each form."""
    rig, own, beside, truth = (
        _measured(cases, hidden, number) if cases and source == "measured" else simulated(hidden, number)
    )
    in_time = diagnose(rig, beside)
    row: Row = {"time": _shown(in_time, truth, None)}
    made = own.frequency_response()
    with tempfile.TemporaryDirectory() as folder:
        for form in FORMS:
            path = Path(folder) / ("frf" + form if form.startswith(".") else "std.csv")
            (made if form.startswith(".") else _with_std_alone(made)).save(path)
            row[form] = _shown(diagnose(rig, FrequencyResponse.load(path, rig)), truth, in_time)
    return row


def _with_std_alone(made: FrequencyResponse) -> FrequencyResponse:
    names = {"outputs": made.outputs, "inputs": made.inputs}
    return FrequencyResponse.from_arrays(made.frequency_hz, made.response, std=made.std, **names)


def _measured(cases: Path, hidden: str, number: int) -> tuple[Rig, Record, Record, dict[str, float]]:
    """Rig file, half of one record, all of the other one, and true values."""
    folder = next(cases / name for name, own in MEASURED.items() if own == hidden)
    rig = Rig.load(folder / "rig.toml")
    paths = sorted(folder.glob("train.*")) + sorted(folder.glob("validate.*"))
    one, beside = (Record.load(path, rig) for path in (paths if number < 2 else paths[::-1]))
    half = one.periods // 2 * one.period
    own = one.rows(0, half) if number % 2 == 0 else one.rows(half, 2 * half)
    answers = json.loads((cases / "answers.json").read_text())[folder.name]
    return rig, own, beside, _truth(rig, answers["K_i"], answers["K_s"], answers["tau_e"])


def simulated(hidden: str, number: int) -> tuple[Rig, Record, Record, dict[str, float]]:
    """The same of a record of the simulator, of which the second half is the record in time."""
    bench = replace(BENCHES["bench"], periods=6)
    effects = {hidden: sized(hidden, "clear").parameters} if hidden else {}
    i_e = bench.excitation(bench.amplitude, number)
    record = simulate(bench.rig, i_e, effects, period=bench.period, seed=number, **bench.truth, **bench.noise)
    half = 3 * bench.period
    return (
        bench.rig,
        record.rows(0, half),
        record.rows(half, 2 * half),
        _truth(bench.rig, bench.K_i, bench.K_s, bench.tau_e),
    )


def _truth(rig: Rig, k_i: Sequence[float], k_s: Sequence[float], tau_e: float) -> dict[str, float]:
    names = [f"{own}.{axis}" for own in ("K_i", "K_s") for axis in rig.axes] + ["tau_e"]
    return dict(zip(names, (*k_i, *k_s, tau_e), strict=True))


def _shown(found: Diagnosis, truth: dict[str, float], beside: Diagnosis | None) -> Row:
    """Names, and how far the nine parameters are from the truth and from those of another diagnosis."""
    own = {name: found.parameters[name] for name in truth}
    row: Row = {
        "verdict": found.verdict,
        "effects": sorted({*found.effects, *(name for names in found.ambiguous_sets for name in names)}),
        "misfit": found.history[-1].misfit if found.history else float("nan"),
        "away": [(p.value - truth[name]) / p.std_error for name, p in own.items()],
    }
    if beside is not None:
        row["apart"] = [
            (p.value - beside.parameters[name].value) / np.hypot(p.std_error, beside.parameters[name].std_error)
            for name, p in own.items()
        ]
    return row


def rows_of(rows: list[Row]) -> list[tuple[object, ...]]:
    """A line of the table for every kind of record, effect and form."""
    found = []
    for source in ("measured", "simulated"):
        for hidden in HIDDEN:
            own = [row for row in rows if row["key"][:2] == [source, hidden]]
            if not own:
                continue
            for form in ("time", *FORMS):
                shown = [row[form] for row in own]
                away = np.abs([one["away"] for one in shown])
                apart = [abs(z) for one in shown for z in one.get("apart", ())]
                found.append(
                    (
                        source,
                        hidden or "nothing",
                        form,
                        len(own),
                        sum(_is_wrong(one, hidden) for one in shown),
                        sum(hidden in one["effects"] for one in shown) if hidden else "",
                        sum(
                            set(one["effects"]) == set(row["time"]["effects"])
                            for one, row in zip(shown, own, strict=True)
                        ),
                        rate_text(int(np.sum(away < NORMAL_95)), away.size),
                        spread_text([one["misfit"] for one in shown]),
                        f"{away.max():.1f}",
                        f"{max(apart):.1f}" if apart else "",
                    )
                )
    return found


def spread_text(misfits: Sequence[float]) -> str:
    """Mean of J/dof, and its root mean square about 1."""
    return f"{np.mean(misfits):.3f}, {np.sqrt(np.mean((np.asarray(misfits) - 1.0) ** 2)):.3f}"


def _is_wrong(one: Row, hidden: str) -> bool:
    """A name that is not hidden, and not beside the one that is in a set that is said to be one."""
    return bool(set(one["effects"]) - {hidden}) and (hidden not in one["effects"] or one["verdict"] == "explained")


def main() -> None:
    """Run what is missing in the file, or report what it holds."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cases", type=Path, help="folder of measured records with answers.json")
    parser.add_argument("--hidden", nargs="*", default=HIDDEN, choices=HIDDEN)
    parser.add_argument("--seeds", type=int, default=24, help="simulated records of each")
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if not (given.report or given.table):
        counts = {"simulated": given.seeds} | ({"measured": 4} if given.cases else {})
        jobs = [
            (source, hidden, k) for source, count in counts.items() for hidden in given.hidden for k in range(count)
        ]
        run_all(partial(run, given.cases), jobs, given.out, given.workers)
        return
    rows = read_rows(given.out)
    if given.report:
        print(aligned(HEAD, rows_of(rows)))
    if given.table:
        given.table.write_text(markdown(HEAD, rows_of(rows)))


if __name__ == "__main__":
    main()
