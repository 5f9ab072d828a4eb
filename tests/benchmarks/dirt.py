"""What dirt on a record does: is it named, does a wrong effect get a name, is the right one still found?

    python tests/benchmarks/dirt.py --out dirt.jsonl
    python tests/benchmarks/dirt.py --out dirt.jsonl --report --table dirt.md

Each kind of `tests/hidden/dirt.py` on a mass on one axis (20 seeds) and on a spindle on four (5 seeds), with nothing
hidden and with one effect. Runs go on where the file ends; no part of it is a test.
"""

import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import diagnose, identify
from ambid.checking import check
from ambid.errors import AmbidError
from benchmarks.grid import Row, aligned, markdown, options, rate_text, read_rows, run_all
from hidden.bench import simulate
from hidden.dirt import DELAYED, DELAYS, DIRT, MARGIN, NOISE_FREE, shifted, soiled
from hidden.families import BENCHES
from hidden.one_axis import NAMED, ONE_AXIS
from hidden.sizes import sized

HIDDEN = {"one": ("foundation_resonance", "flux_saturation", "sensor_lag"), "four": ("seal_forces", "sensor_lag")}
SEEDS = {"one": 20, "four": 5}
SAME = {
    "scaled_y": ("controller_gain_error", "channel_gain"),
    **dict.fromkeys(("late_y", "late_card", "late_i_e", "delayed_y", "delayed_i_e"), ("channel_delay",)),
    **dict.fromkeys(("late_i_c", "delayed_i_c"), ("sampling_skew",)),
}
"""Names of a kind of dirt: one factor on y, or on all gains; channels read at another instant."""
FAR = 3.0
"""Standard errors beyond which a value is off."""
HEAD = (
    "dirt",
    "hidden",
    "runs",
    "refused or stopped",
    "named by check",
    "values off",
    "of them reported",
    "wrong name",
    "right name",
)


def run(axes: str, kind: str, is_hidden: bool, seed: int) -> Row:
    """Check, identify and diagnose one dirty record."""
    bench = ONE_AXIS if axes == "one" else BENCHES["bench"]
    names = HIDDEN[axes]
    hidden = {}
    if is_hidden:
        name = names[seed % len(names)]
        hidden = {name: NAMED[name] if axes == "one" else sized(name, "clear").parameters}
    random = np.random.default_rng([seed, len(axes), is_hidden])
    one_period = bench.excitation(bench.amplitude, seed)[: bench.period]
    i_e = np.take(one_period, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    quiet = {"seed": None} if kind == NOISE_FREE else {"seed": seed, **bench.noise}
    machine, of_y, late = hidden, 0.0, 0.0
    if kind in DELAYED:
        late = float(np.exp(random.uniform(*np.log(DELAYS))))
        of_y, of_i_c = DELAYED[kind]
        machine = hidden | ({"sampling_skew": {"seconds": of_i_c * late / bench.rig.sample_rate}} if of_i_c else {})
    record = simulate(bench.rig, i_e, machine, period=bench.period, **bench.truth, **quiet)
    record = replace(record, y=shifted(record.y, of_y * late)) if of_y else record
    row: Row = {"hidden": list(hidden), "late": late, "told": [], "off": False, "verdict": "refused", "effects": []}
    try:
        record = soiled(record, kind, random, bench.rig)
    except AmbidError as error:
        return {**row, "told": [str(error)]}
    found = check(bench.rig, [record]).findings
    row["told"] = [f"{own.severity}: {own.line(advises=False)}" for own in found if own.severity != "note"]
    try:
        estimate = identify(bench.rig, record)
        truth = {"tau_e": bench.tau_e}
        for axis, k_i, k_s in zip(bench.rig.axes, bench.K_i, bench.K_s, strict=True):
            truth |= {f"K_i.{axis}": k_i, f"K_s.{axis}": k_s}
        away = [
            abs(p.value - truth[name]) / p.std_error
            for name, p in estimate.parameters.items()
            if name in truth and p.std_error and np.isfinite(p.std_error)
        ]
        row |= {
            "status": estimate.status,
            "misfit": estimate.misfit,
            "is_adequate": bool(estimate.is_adequate),
            "away": max(away, default=0.0),
            "notes": list(getattr(estimate, "notes", ())),
        }
        row["off"] = bool(row["away"] > FAR and not hidden)
        diagnosis = diagnose(bench.rig, record)
    except AmbidError as error:
        return {**row, "verdict": "error", "error": str(error)}
    effects = {*diagnosis.effects, *(name for names in diagnosis.ambiguous_sets for name in names)}
    return {**row, "verdict": diagnosis.verdict, "effects": sorted(effects), "sets": diagnosis.ambiguous_sets}


def rows_of(rows: list[Row]) -> list[tuple[object, ...]]:
    """A line of the table for every kind, without and with something hidden."""
    found = []
    for kind in (*DIRT, *DELAYED, NOISE_FREE):
        for is_hidden in (False, True):
            own = [row for row in rows if row["key"][1] == kind and row["key"][2] == is_hidden]
            if not own:
                continue
            stopped = [row for row in own if row["verdict"] in ("refused", "not_informative", "error")]
            shown = [row for row in own if row["told"]]
            off = [row for row in own if row["off"]]
            warned = [row for row in off if row["told"] or not row["is_adequate"]]
            wrong = [row for row in own if _is_wrong(row)]
            right = [row for row in own if row["hidden"] and set(row["hidden"]) <= set(row["effects"])]
            found.append(
                (
                    kind,
                    "one effect" if is_hidden else "nothing",
                    len(own),
                    len(stopped),
                    len(shown),
                    len(off),
                    f"{len(warned)}/{len(off)}",
                    len(wrong),
                    len(right) if is_hidden else "",
                )
            )
    return found


def _is_wrong(row: Row) -> bool:
    """A name that is neither hidden nor what the dirt itself is called."""
    named = set(row["effects"]) - set(row["hidden"]) - set(SAME.get(row["key"][1], ()))
    right = set(row["hidden"]) & set(row["effects"])
    return bool(named) and (not right or row["verdict"] == "explained")


def main() -> None:
    """Run what is missing in the file, or report what it holds."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--kinds", nargs="*", default=[*DIRT, *DELAYED, NOISE_FREE])
    parser.add_argument("--axes", nargs="*", default=["one", "four"])
    parser.add_argument("--seeds", type=int, help="of each; default 20 on one axis and 5 on four")
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if not (given.report or given.table):
        jobs = [
            (axes, kind, is_hidden, seed)
            for axes in given.axes
            for kind in given.kinds
            for is_hidden in (False, True)
            for seed in range(given.seeds or SEEDS[axes])
        ]
        run_all(run, jobs, given.out, given.workers)
        return
    rows = read_rows(given.out)
    wrong = [row for row in rows if _is_wrong(row)]
    if given.report:
        print(aligned(HEAD, rows_of(rows)))
        print("wrong names:", rate_text(len(wrong), len(rows)))
    if given.table:
        given.table.write_text(markdown(HEAD, rows_of(rows)))


if __name__ == "__main__":
    main()
