"""Machines whose rig file is off by ordinary tolerances: what is called adequate, what is named, which intervals hold.

    python tests/benchmarks/tolerances.py made.jsonl --identify 600 --diagnose 100
    python tests/benchmarks/tolerances.py made.jsonl --report

Every value of the rig file is off by a draw of its own. `--identify` fits so many machines in which nothing else is
hidden, with the tolerances and as if the rig file were exact, and times both; `--aperiodic` likewise, of records loaded
without their period; `--diagnose` diagnoses so many of these, and as many of each effect, of clear size, and of errors
of three and of ten tolerances. It goes on where it stopped.
No part of the tests.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Record, Rig, diagnose, identify, prbs
from benchmarks.grid import NORMAL_95, Row, options, rate_text, read_rows, run_all
from hidden.families import BENCHES
from hidden.sizes import sized
from hidden.tolerances import TABLE, Machine, machine_off
from places import LEVITATOR

LEVITATORS = {"K_i": [165.0], "K_s": [1.1e6], "tau_e": 2.4e-4}
MACHINES = ("levitator", "bench", "small", "compressor")
CLEAR = ("seal_forces", "bending_mode_shift", "loop_delay", "foundation_resonance", "force_nonlinearity")
TIMES = ("sensor_gain_error x 3", "sensor_gain_error x 10", "sensor_position_error x 3", "sensor_position_error x 10")
"""Errors of one sensor, in tolerances."""


def made(name: str, seed: int, effect: str = "") -> tuple[Machine, list[Record], dict[str, float]]:
    """A machine, two records of it, and its true parameters."""
    if name == "levitator":
        rig, truth = Rig.load(LEVITATOR), LEVITATORS
        noise = {"sensor_noise": 30e-9, "current_noise": 2e-3, "period": 2 * (2**8 - 1)}
        i_e = [prbs(8, amplitude=0.2, hold=2, axes=1, periods=8, seed=2 * seed + k) for k in range(2)]
    else:
        bench = BENCHES[name]
        rig, truth, noise = bench.rig, bench.truth, {**bench.noise, "period": bench.period}
        i_e = [bench.excitation(bench.amplitude, 2 * seed + k) for k in range(2)]
    off, beside = machine_off(rig, seed), {}
    if effect in CLEAR:
        one = sized(effect, "clear", name)
        beside = {effect: dict(one.parameters)}
        i_e = [one.amplitude / np.abs(own).max() * own for own in i_e]
    elif effect:
        kind, _, factor = effect.partition(" x ")
        key, tolerance = {
            "sensor_gain_error": ("gain", TABLE["sensor_gain"]),
            "sensor_position_error": ("dz", TABLE["sensor_position"]),
        }[kind]
        own = list(off.hidden[kind][key])
        own[0] += float(factor) * tolerance
        beside = {kind: {key: own}}
    records = [off.record(own, 2 * seed + k, beside, **truth, **noise) for k, own in enumerate(i_e)]
    values = {f"{k}.{axis}": v for k in ("K_i", "K_s") for axis, v in zip(rig.axes, truth[k], strict=True)}
    return off, records, values | {"tau_e": truth["tau_e"]}


def run(job: str, name: str, effect: str, seed: int) -> Row:
    off, (record, other), truth = made(name, seed, effect)
    if job == "diagnose":
        begun = time.perf_counter()
        found = diagnose(off.known, [record], validate=[other])
        sets = [sorted(own) for own in found.ambiguous_sets]
        seconds = time.perf_counter() - begun
        own = {"verdict": found.verdict, "effects": list(found.effects), "sets": sets, "seconds": seconds}
        return own | {"misfit": found.fit.misfit}
    if job == "aperiodic":
        record = replace(record, period=None)
    seconds, each = {}, {}
    for what, rig in (("exact", off.known.exact()), ("tolerances", off.known)):
        begun = time.perf_counter()
        each[what] = identify(rig, record)
        seconds[what] = time.perf_counter() - begun
    found = each["tolerances"]
    parameters = found.parameters
    return {
        "status": found.status,
        "adequate": found.is_adequate,
        "misfit": found.misfit,
        "exact_misfit": each["exact"].misfit,
        "off": [(parameters[key].value - value) / parameters[key].std_error for key, value in truth.items()],
        "statistical": [(parameters[k].value - v) / parameters[k].std_error_statistical for k, v in truth.items()],
        "seconds": seconds,
    }


def jobs(identified: int, aperiodic: int, diagnosed: int) -> Iterator[tuple[str, str, str, int]]:
    """Job, machine, effect and seed of every run."""
    for job, count in (("identify", identified), ("aperiodic", aperiodic)):
        for seed in range(count):
            yield job, MACHINES[seed % len(MACHINES)], "", seed
    for effect in ("", *TIMES, *CLEAR):
        some = [m for m in MACHINES if m != "levitator" or effect in ("", *TIMES[:2])]
        for seed in range(diagnosed):
            yield "diagnose", some[seed % len(some)], effect, seed


def report_fits(job: str, fits: list[Row]) -> None:
    """Print the rates of the fits of one job."""
    for name in (*MACHINES, "all"):
        own = [row for row in fits if name in ("all", row["key"][1])]
        if not own:
            continue
        inside = [abs(z) < NORMAL_95 for row in own for z in row["off"]]
        alone = [abs(z) < NORMAL_95 for row in own for z in row["statistical"]]
        ratio = np.median([row["seconds"]["tolerances"] / row["seconds"]["exact"] for row in own])
        misfits = [row["misfit"] for row in own]
        print(f"{job:10s} {name:12s} adequate {rate_text(sum(row['adequate'] for row in own), len(own))}")
        print(f"{'':23s} intervals hold {rate_text(sum(inside), len(inside))}; by noise {100 * np.mean(alone):.1f} %")
        print(
            f"{'':23s} J/dof median {np.median(misfits):.4f}, mean {np.mean(misfits):.4f}, largest {max(misfits):.4f}"
        )
        print(f"{'':23s} time over an exact fit {ratio:.2f}")


def report(rows: list[Row]) -> None:
    """Print the rates."""
    for job in ("identify", "aperiodic"):
        report_fits(job, [row for row in rows if row["key"][0] == job])
    for effect in ("", *TIMES, *CLEAR):
        own = [row for row in rows if row["key"][0] == "diagnose" and row["key"][2] == effect]
        if not own:
            continue
        name = effect.partition(" x ")[0]
        right = [row["effects"] == ([name] if name else []) and not row["sets"] for row in own]
        in_set = [name in row["effects"] or any(name in own for own in row["sets"]) for row in own]
        words = {word: sum(row["verdict"] == word for row in own) for word in sorted({row["verdict"] for row in own})}
        print(f"{effect or 'nothing':28s} alone {rate_text(sum(right), len(own))}; in its set {sum(in_set)}; {words}")


if __name__ == "__main__":
    parser = options(__doc__, workers=1)
    parser.add_argument("out", type=Path)
    parser.add_argument("--identify", type=int, default=0)
    parser.add_argument("--aperiodic", type=int, default=0)
    parser.add_argument("--diagnose", type=int, default=0)
    given = parser.parse_args()
    if not given.report:
        run_all(run, jobs(given.identify, given.aperiodic, given.diagnose), given.out, given.workers)
    report(read_rows(given.out))
