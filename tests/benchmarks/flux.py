"""What Hall sensors distinguish: sets and probabilities of hidden effects with and without the flux density b.

    python tests/benchmarks/flux.py flux.jsonl --seeds 3
    python tests/benchmarks/flux.py flux.jsonl --report --table flux.md

Records of a mass on one axis by the independent simulator, each effect barely visible (30 in J, in y and i_c) and
clear (1e4), diagnosed four times: of y alone, of y and i_c, and of both with b beside them; with typical tolerances.
The gain of b is as well known as Hall sensors are. It goes on where it stopped; no part of the tests.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Record, Rig, diagnose
from benchmarks.grid import Row, aligned, markdown, options, read_rows, run_all
from hidden.bench import measured
from hidden.machine import magnet
from hidden.network import library
from hidden.one_axis import ONE_AXIS
from hidden.sizes import TARGETS, find

EFFECTS = (
    "nothing",
    "eddy_currents",
    "magnetic_hysteresis",
    "amplifier_bandwidth",
    "loop_delay",
    "sensor_lag",
    "flux_saturation",
)
SIZES = ("barely", "clear")
AREA = 3e-4
"""Of a pole [m^2]."""
NOISE = 2e-3
"""Rms of a Hall sensor with its amplifier in the band of the record [T]."""
CHANNELS = {"y": (False, False), "y, i_c": (True, False), "y, b": (False, True), "y, i_c, b": (True, True)}
"""Whether i_c and b were recorded."""
HEAD = ("hidden", "size", "recorded", "runs", "P of what is hidden", "most probable sets, mean probability")


def instrumented(hidden: dict) -> Rig:
    """The rig with Hall sensors, the bias flux being that of the iron."""
    iron = hidden.get("flux_saturation", {"level": 0.0, "curve": "linear"})
    law = magnet(*ONE_AXIS.K_i, *ONE_AXIS.K_s, ONE_AXIS.rig.bearings[0].bias_current, **iron)
    flux = np.sqrt(4e-7 * np.pi * law[2] / AREA) * library().iron(law[5], law[6]) / law[6]
    data = ONE_AXIS.rig.model_dump(by_alias=True, exclude_none=True) | {"tolerance": {}}
    data["bearing"][0].update(pole_area=AREA, bias_flux=float(flux))
    return Rig(**data)


def made(effect: str, size: str, seed: int) -> tuple[Rig, Record]:
    """A record of everything, and its rig."""
    hidden, amplitude = {}, ONE_AXIS.amplitude
    if effect != "nothing":
        own = find(effect, TARGETS[size], ONE_AXIS)
        hidden, amplitude = {effect: own.parameters}, own.amplitude
    rig = instrumented(hidden)
    further = {f"b.{axis}": NOISE for axis in rig.axes}
    i_e = ONE_AXIS.excitation(amplitude, seed)
    return rig, measured(rig, i_e, hidden, seed=seed, further=further, **ONE_AXIS.noise, **ONE_AXIS.truth)


def run(effect: str, size: str, seed: int) -> Row:
    """Diagnose a record by its channels."""
    rig, record = made(effect, size, seed)
    truth = set() if effect == "nothing" else {effect}
    row: Row = {}
    for name, (has_i_c, has_b) in CHANNELS.items():
        seen = replace(record, i_c=record.i_c if has_i_c else None, further=record.further if has_b else {})
        found = diagnose(rig, seen)
        sets = [(list(own.effects), own.probability) for own in found.probabilities.sets]
        row[name] = {"verdict": found.verdict, "sets": sets}
        row[name]["right"] = sum(p for own, p in sets if set(own) == truth)
    return row


def report(rows: list[Row]) -> Iterator[list[str]]:
    """A line for each effect, size and choice of channels."""
    for effect in EFFECTS:
        for size in SIZES:
            own = [row for row in rows if row["key"][:2] == [effect, size]]
            for name in CHANNELS if own else ():
                mean: dict[str, float] = {}
                for row in own:
                    for effects, probability in row[name]["sets"]:
                        key = " + ".join(sorted(effects)) or "nothing"
                        mean[key] = mean.get(key, 0.0) + probability / len(own)
                first = sorted(mean.items(), key=lambda item: -item[1])[:3]
                shown = ", ".join(f"{key} {value:.2f}" for key, value in first if value >= 0.005)
                right = np.mean([row[name]["right"] for row in own])
                yield [effect, size, name, str(len(own)), f"{right:.2f}", shown]


def main() -> None:
    """Make the rows, or report those that are there."""
    parser = options(__doc__, workers=1)
    parser.add_argument("rows", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--table", type=Path, help="write it as Markdown")
    given = parser.parse_args()
    if not given.report:
        jobs = [
            (effect, size, seed)
            for seed in range(given.seeds)
            for effect in EFFECTS
            for size in (SIZES if effect != "nothing" else SIZES[:1])
        ]
        run_all(run, jobs, given.rows, given.workers)
    lines = list(report(read_rows(given.rows)))
    print(aligned(HEAD, lines))
    if given.table is not None:
        given.table.write_text(markdown(HEAD, lines))


if __name__ == "__main__":
    main()
