"""J/dof of right models in noise that the controller hears, noise of the recorder alone, and both at once.

    python tests/benchmarks/recorder_noise.py made.jsonl --count 300
    python tests/benchmarks/recorder_noise.py made.jsonl other.jsonl --table

The records are a balanced, seeded sample (a Latin hypercube in blocks) over machines, where the noise arises, its
colour or converter, lengths and numbers of periods; the model is the exact one, so that the noise alone is judged
(`--fit` also fits it). It goes on where it stopped. The table has the mean of J/dof and its scatter of every cell, at
last in units of sqrt(2 dof), one file beside another. No part of the tests.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ambid import Model, Record, Rig, identify, prbs
from ambid.diagnosis import compare
from hidden.bench import simulate
from hidden.families import BENCHES, Bench
from hidden.one_axis import ONE_AXIS
from hidden.strangers import stranger

PLACES = ("recorder", "loop", "both")
COLOURS = ("white", "0.7", "0.95", "converter")
"""Converters round what is recorded; its noise before that is white."""
BITS = (12, 13, 14, 15, 16)
STEPS = (0.4, 1.0)
"""Rms of all noise before a converter, in its steps, at the least and at the most: see `null_cells.SHARES`."""
ONE, FOUR = "one axis", "four axes"
MACHINES = (ONE, FOUR)
FOURS = ("bench", "small", "compressor", *range(1, 13))
"""Machines of four axes; numbers are strangers."""
ORDERS, HOLDS, PERIODS = (7, 8, 9, 10, 11), (1, 2, 4, 8), (3, 4, 6, 10, 20)
MOST = {ONE: 120_000, FOUR: 60_000}
"""Samples of a record; longer ones have fewer periods, or a shorter hold."""
WITHOUT = 12_000
"""Samples of a record without periods, at the most."""
BLOCK = 120


@dataclass(frozen=True)
class Cell:
    """Levels of one record."""

    machine: str
    place: str
    colour: str
    implementation: str
    order: int
    hold: int
    periods: int
    bits: int
    steps: float
    level: float
    """Of the noise in y, over the machine's usual one."""

    @property
    def samples(self) -> int:
        """Of the record."""
        return (2**self.order - 1) * self.hold * self.periods


def cell(index: int) -> Cell:
    """Levels of the record of that number."""
    own = _block(index // BLOCK)[index % BLOCK]
    while own.samples > MOST[own.machine] and own.periods > PERIODS[0]:
        own = replace(own, periods=PERIODS[PERIODS.index(own.periods) - 1])
    while own.samples > MOST[own.machine]:
        own = replace(own, hold=own.hold // 2)
    return own


@cache
def _block(number: int) -> list[Cell]:
    random = np.random.default_rng([number, 11])

    def spread(levels) -> list:
        levels = list(levels)
        random.shuffle(levels)
        return [levels[k % len(levels)] for k in random.permutation(BLOCK)]

    columns = (
        spread(product(MACHINES, PLACES, COLOURS)),
        *(spread(levels) for levels in (("analog", "digital"), ORDERS, HOLDS, PERIODS, BITS)),
        STEPS[0] + (STEPS[1] - STEPS[0]) * random.random(BLOCK),
        np.exp(random.uniform(np.log(0.3), np.log(3.0), BLOCK)),
    )
    return [
        Cell(*where, *(x.item() if isinstance(x, np.generic) else x for x in levels))
        for where, *levels in zip(*columns, strict=True)
    ]


@cache
def machine(index: int) -> Bench:
    """That of the record of that number."""
    own = cell(index)
    if own.machine == ONE:
        return ONE_AXIS
    which = FOURS[index % len(FOURS)]
    return BENCHES[which] if isinstance(which, str) else stranger(which)


def made(index: int, *, periodic: bool = True) -> tuple[Rig, Record, Model]:
    """Rig, record and exact model of that number; without periods, of as many samples up to `WITHOUT`."""
    own, bench = cell(index), machine(index)
    rig = bench.rig
    if own.implementation != rig.controller.implementation and own.machine == ONE:
        rig = rig.replace(controller=rig.controller.model_copy(update={"implementation": own.implementation}))
    y, colour, step = own.level * bench.sensor_noise, None, 0.0
    if own.colour == "converter":
        step = 2.0 * rig.bearings[0].air_gap / 2**own.bits
        y = own.steps * step
    elif own.colour != "white":
        colour = [1.0], [1.0, -float(own.colour)]
    heard, unheard = {"recorder": (0.0, y), "loop": (y, 0.0), "both": (y, y)}[own.place]
    i_e = prbs(own.order, amplitude=bench.amplitude, hold=own.hold, axes=len(rig.axes), periods=own.periods, seed=index)
    if not periodic:
        signs = np.random.default_rng([index, 3]).choice(
            [-1.0, 1.0], (min(len(i_e), WITHOUT) // own.hold, len(rig.axes))
        )
        i_e = np.repeat(bench.amplitude * signs, own.hold, axis=0)
    record = simulate(
        rig,
        i_e,
        seed=index,
        sensor_noise=heard,
        current_noise=bench.current_noise,
        colour=colour,
        recorder_noise=unheard,
        recorder_colour=colour,
        recorder_step=step,
        period=(2**own.order - 1) * own.hold if periodic else None,
        **bench.truth,
    )
    true = {"tau_e": bench.tau_e}
    for name, values in (("K_i", bench.K_i), ("K_s", bench.K_s)):
        true |= {f"{name}.{axis}": value for axis, value in zip(rig.axes, values, strict=True)}
    return rig, record, Model(rig).with_values(true)


def result(index: int, *, fit: bool, periodic: bool) -> dict:
    """What is found of the record of that number."""
    rig, record, exact = made(index, periodic=periodic)
    begun = time.process_time()
    found = compare(exact, record)
    shown = {"index": index, "misfit": found.misfit, "dof": found.dof, "seconds": time.process_time() - begun}
    shown["spread"] = float(np.mean(found.noise.spreads))
    if fit:
        shown["fitted"] = identify(rig, record).misfit
    return shown


def levels(index: int) -> list[str]:
    """Names of the cells of a record in the table."""
    own = cell(index)
    return [
        "all",
        own.machine,
        own.place,
        own.colour,
        f"{own.machine}, {own.place}",
        f"{own.place}, {own.colour}",
        f"chips {2**own.order - 1}",
        f"hold {own.hold}",
        f"periods {own.periods}",
        own.implementation if own.machine == ONE else "analog or digital",
    ]


def table(paths: list[Path]) -> None:
    """Print mean and scatter of every cell, the files beside each other."""
    files = [{r["index"]: r for r in map(json.loads, path.read_text().splitlines()) if "misfit" in r} for path in paths]
    shared = sorted(set.intersection(*(set(own) for own in files)))
    cells: dict[str, list[int]] = {}
    for index in shared:
        for name in levels(index):
            cells.setdefault(name, []).append(index)
    order = ["all", *(k for k in sorted(cells) if k != "all")]
    print(
        f"{'cell':22s} {'count':>5s}"
        + f" | {'mean':>6s} {'std':>5s} {'least':>6s} {'most':>6s} {'chi':>5s}" * len(files)
    )
    for name in order:
        line = f"{name:22s} {len(cells[name]):5d}"
        for own in files:
            misfit, dof = (np.array([own[k][what] for k in cells[name]]) for what in ("misfit", "dof"))
            chi = (misfit - 1.0) / np.sqrt(2.0 / dof)
            # weighed by what is known: short records scatter by chance
            mean = float(np.average(misfit, weights=dof / (1.0 + dof * 2e-4)))
            line += f" | {mean:6.3f} {misfit.std():5.3f} {misfit.min():6.3f} {misfit.max():6.3f}"
            line += f" {np.sqrt(np.mean(chi**2)):5.2f}"
        print(line)
    for own, path in zip(files, paths, strict=True):
        print(path, "seconds:", np.round(np.percentile([own[k]["seconds"] for k in shared], [50, 90, 100]), 3))


def main() -> None:
    """Make what is not there, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--count", type=int, default=BLOCK)
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--without-periods", action="store_true")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    if given.table:
        table(given.files)
        return
    path = given.files[0]
    done = {json.loads(line)["index"] for line in path.read_text().splitlines()} if path.exists() else set()
    with path.open("a") as out:
        for index in (k for k in range(given.count) if k not in done):
            try:
                shown = result(index, fit=given.fit, periodic=not given.without_periods)
            except (ValueError, RuntimeError) as error:
                shown = {"index": index, "error": str(error)[:200]}
            out.write(json.dumps(shown) + "\n")
            out.flush()


if __name__ == "__main__":
    main()
