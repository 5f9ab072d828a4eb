"""Do the 95 % intervals of the sensitivity's peaks hold the truth 95 % of the time? Records of many seeds.

    python tests/benchmarks/margins.py --seeds 200 --out margins.jsonl
    python tests/benchmarks/margins.py --out margins.jsonl --report

Runs go on where the file ends; no part of it is a test. Records are those of the independent simulator, with nothing
hidden: of a mass on one axis, of the same excited so little that peaks are bent over their intervals, and of a
two-bearing bench. Intervals of one
record belong to one noise: the interval of the rate over all peaks of a bench is narrower than it should be.
"""

import sys
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

import ambid
from benchmarks.grid import Row, aligned, options, rate_text, read_rows, run_all
from benchmarks.intervals import truth_of
from hidden.bench import measured
from hidden.families import BENCHES, Bench
from hidden.one_axis import ONE_AXIS

MACHINES: dict[str, tuple[Bench, float]] = {
    "one axis": (ONE_AXIS, 1.0),
    "one axis, weak": (ONE_AXIS, 0.003),
    "bench": (BENCHES["bench"], 1.0),
}
"""Machine, and the share of its excitation."""
DRAWS = 500
HEAD = ("machine", "peak", "truth", "within 95 %", "by slopes", "within worst", "off: mean", "std", "zone right")


@cache
def _truth(machine: str) -> dict[str, float]:
    """Peaks of the machine as it is, by axis, and of all together."""
    bench, _ = MACHINES[machine]
    values = truth_of(bench.rig, **bench.truth)
    return _peaks(ambid.margins(ambid.Model(bench.rig).with_values(values)))


def _peaks(found: ambid.Margins) -> dict[str, float]:
    return {**{own.axis: own.sensitivity.value for own in found.axes}, "all": found.multivariable.value}


def run(machine: str, seed: int) -> Row:
    """Identify one record, and hold the margins of the model against those of the machine."""
    bench, share = MACHINES[machine]
    i_e = bench.excitation(share * bench.amplitude)
    noise = seed + 10**6 * list(MACHINES).index(machine)
    record = measured(bench.rig, i_e, {}, seed=noise, **bench.truth, **bench.noise)
    try:
        found = ambid.margins(ambid.identify(bench.rig, record).model, draws=DRAWS, seed=seed)
    except ambid.AmbidError as error:
        return {"error": f"{type(error).__name__}: {error}", "peaks": {}}
    own = {each.axis: each.sensitivity for each in found.axes} | {"all": found.multivariable}
    peaks = {}
    for name, true in _truth(machine).items():
        peak = own[name]
        peaks[name] = {
            "within": peak.ci95[0] <= true <= peak.ci95[1],
            "below_worst": true <= peak.worst,
            "off": (peak.value - true) / peak.std_error if peak.std_error else None,
            "zone_right": ambid.robustness.zone_of(true) == ambid.robustness.zone_of(peak.value),
        }
    return {"peaks": peaks, "unstable": found.unstable, "draws": found.draws}


def table(rows: list[Row]) -> list[list[str]]:
    """A line for each peak of each machine."""
    lines = []
    for machine in MACHINES:
        own = [row for row in rows if row["key"][0] == machine]
        failed = sum("error" in row for row in own)
        for name, true in _truth(machine).items() if own else ():
            seen = [row["peaks"][name] for row in own if row["peaks"]]
            off = np.array([one["off"] for one in seen if one["off"] is not None])
            rate, below, right = (
                rate_text(sum(one[key] for one in seen), len(seen)) for key in ("within", "below_worst", "zone_right")
            )
            slopes = rate_text(int(np.sum(np.abs(off) <= 1.959964)), len(off)) if len(off) else ""
            spread = [f"{off.mean():.2f}", f"{off.std():.2f}"] if len(off) else ["", ""]
            lines.append([machine, name, f"{true:.3f}", rate, slopes, below, *spread, right])
        if failed:
            lines.append([machine, "errors", "", str(failed), *[""] * 5])
    return lines


def main() -> None:
    """Run what is missing in the file, or report what it holds."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--machines", nargs="*", choices=MACHINES, default=list(MACHINES))
    given = parser.parse_args()
    if given.report:
        print(aligned(HEAD, table(read_rows(given.out))))
        return
    run_all(
        run, [(machine, seed) for seed in range(given.seeds) for machine in given.machines], given.out, given.workers
    )


if __name__ == "__main__":
    main()
