"""Fits a second: descents alone in the core, and whole identifications; and what memory many of them take.

Run from `tests` with ``python benchmarks/ensemble.py``; no part of the tests. The loop and the record are those of
`speed.py`: 24 states, nine parameters, 20 000 samples. Rates are by wall time, and by that of the processor.
"""

import argparse
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.fft import rfft
from speed import PERIOD, SAMPLES, excitation, rigid

from ambid import _core
from ambid.excitation import prbs
from ambid.identification import identify, identify_many
from ambid.identification.many import fit_for_core
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import Descent, Problem, noise_levels
from ambid.model import Model
from ambid.noise import Noise
from ambid.rig import Rig
from virtual import VirtualBench


def rate(job: Callable[[], object], fits: int) -> str:
    wall, used = time.perf_counter(), time.process_time()
    job()
    wall, used = time.perf_counter() - wall, time.process_time() - used
    return f"{fits / wall:8.1f} fits/s ({fits / used:8.1f} by the processor)"


def records(model: Model, count: int, samples: int = SAMPLES) -> list:
    u = excitation(samples)
    made = (model.virtual_experiment(u, seed=seed) for seed in range(count))
    return [replace(record, period=PERIOD) for record in made]


def descents(start: Model, some: list, of: str) -> list:
    """The last descent of every record, with all that comes before it done."""
    free = list(range(len(start.theta)))
    made = []
    for record in some:
        if of == "lines":
            problem = WhitenedProblem(start, Noise(start, [record]), free)
        else:
            levels = noise_levels([record])
            factors = np.repeat([1.0, 0.0] if of == "samples of y" else [1.0, 1.0], len(record.axes))
            problem = Problem(start, (record,), free, levels, factors, None)
        limits = (np.zeros(len(free)), np.full(len(free), np.inf))
        descent = Descent(problem, start.theta / problem.scale, limits, 100)
        made.append(fit_for_core(descent))
    return made


def against_periods(rig: Rig, order: int = 10, hold: int = 2, runs: int = 4) -> None:
    """Time of the processor that an identification takes, and the transforms of its record alone."""
    model, period = Model(rig), hold * (2**order - 1)
    start = model.with_values({p.name: 1.05 * p.value for p in model.parameters if p.name.startswith("K_i")})
    print(f"{'periods':>8s} {'identify_many':>16s} {'but for transforms':>20s}")
    for periods in (2, 4, 8, 16, 32, 64):
        u = prbs(order, amplitude=0.1, hold=hold, axes=len(rig.axes), periods=periods)
        some = [replace(model.virtual_experiment(u, seed=seed), period=period) for seed in range(runs)]
        identify_many(start, some[:1])
        whole = processor_ms(lambda some=some: identify_many(start, some)) / runs
        transforms = processor_ms(lambda some=some: [rfft(some[0].y, axis=0) for _ in range(2)])
        print(f"{periods:8d} {whole:13.1f} ms {whole - transforms:17.1f} ms", flush=True)


def processor_ms(job: Callable[[], object]) -> float:
    begun = time.process_time()
    job()
    return 1e3 * (time.process_time() - begun)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=16)
    parser.add_argument("--many", type=int, default=2000, help="Fits over which memory may not grow.")
    parser.add_argument("--periods", type=Path, metavar="RIG", help="Only: time against the periods, of a rig.")
    given = parser.parse_args()
    if given.periods:
        against_periods(Rig.load(given.periods))
        return
    bench = VirtualBench()
    model, start = Model(rigid(bench.rig())), Model(rigid(bench.rig(off=0.08)))
    some = records(model, given.fits)
    for of in ("lines", "samples of y", "samples of y and i_c"):
        fits = descents(start, some, of)
        print(f"descents on {of:22s} {rate(lambda fits=fits: _core.fit_all(fits), len(fits))}")
    for weights in ("likelihood", "eq9"):
        alone = rate(lambda weights=weights: [identify(start, own, weights=weights) for own in some], len(some))
        print(f"identify, {weights:24s} {alone}")
        beside = rate(lambda weights=weights: identify_many(start, some, weights=weights), len(some))
        print(f"identify_many, {weights:19s} {beside}")
    print("\nidentify_many on lines against the number of periods")
    for periods in (2, 4, 8, 16, 32):
        own = records(model, 4, periods * PERIOD)
        print(f"{periods:4d} periods {rate(lambda own=own: identify_many(start, own), len(own))}")
    fits = descents(start, some, "lines")
    _core.fit_all(fits)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(given.many // len(fits)):
        _core.fit_all(fits)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(f"\n{given.many} fits: peak of memory {before / 1024:.0f} MB, grown by {grown / 1024:.1f} MB")


if __name__ == "__main__":
    main()
