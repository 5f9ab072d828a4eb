"""Seconds of whole jobs, of this version and, in the same run, of another one: identify, rank, diagnose.

    python tests/benchmarks/jobs.py ../shared/cases
    python tests/benchmarks/jobs.py ../shared/cases --against OTHER_ENVIRONMENT/bin/python --jobs identify rank
    python tests/benchmarks/jobs.py --growth
    python tests/benchmarks/jobs.py --long 1e4 1e5 1e6 5e6 --axes 1 4 8 --against OTHER_ENVIRONMENT/bin/python

Every figure is the least of several runs in a process of its own on one core, the versions in turn. The turning rotor
has three modes of 0.3 % and 40 940 samples of four axes, and is simulated once for both. `--growth` shows a fit's cost
against the number of periods, and the memory of long records; `--long` shows seconds of the processor and the peak of
memory of `identify` against samples and axes, with periods and without, each in a process of its own that is given up
beyond a minute or 4 GB; `--table` writes it in Markdown. `PYTHONPATH` is kept from the other version. No part of the
tests.
"""

import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

CASES = ("01", "03", "04", "06", "07")
JOBS = ("identify 01", "rank 01", *(f"diagnose {case}" for case in CASES), "diagnose turning")
OFTEN = {"identify": 15, "rank": 4, "diagnose": 2}
SLOW = 6.0
"""Seconds of a first run after which there is no second."""
MOST_SECONDS, MOST_MEMORY = 60, 4_000_000_000
"""Of a fit to a long record: seconds of the processor, and bytes that may be asked for."""
LONG = ("axes", "samples", "periods", "this, s", "this, GB", "other, s", "other, GB")


def one(job: str, folder: Path) -> None:
    """Print the least time of a job, by whichever version runs this."""
    import ambid

    what, case = job.split()
    rig = ambid.Rig.load(folder / "rig.toml")
    train = ambid.Record.load(next(folder.glob("train.*")), rig)
    kept_back = [ambid.Record.load(path, rig) for path in folder.glob("validate.*")]
    run: Callable[[], object]
    if what == "identify":
        run = lambda: ambid.identify(rig, train).to_json()  # noqa: E731
    elif what == "rank":
        comparison = ambid.compare(ambid.identify(rig, train).model, train)
        run = lambda: ambid.rank(comparison)  # noqa: E731
    else:
        run = lambda: ambid.diagnose(rig, train, validate=kept_back)  # noqa: E731
    least, count = float("inf"), OFTEN[what]
    for k in range(count + 1):
        begun = time.perf_counter()
        run()
        seconds = time.perf_counter() - begun
        if k > 0 or seconds > SLOW:  # the first run also loads what it needs
            least = min(least, seconds)
        if seconds > SLOW:
            break
    print(least)


def turning(folder: Path) -> None:
    """Write rig and record of a turning rotor with three lightly damped modes."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from ambid import prbs
    from hidden.bench import measured
    from hidden.families import BENCHES

    bench = BENCHES["bench"]
    own = {"flexible_modes": 3, "modal_damping": 0.003, "bending_frequencies_hz": None}
    rotor = bench.rig.rotor.model_copy(update=own)
    rig = bench.rig.replace(rotor=rotor, speed=300.0)
    i_e = prbs(11, amplitude=bench.amplitude, hold=2, axes=4, periods=10, seed=1)
    record = measured(rig, i_e, {}, seed=1, **bench.truth, **bench.noise)
    folder.mkdir()
    (folder / "rig.toml").write_text(rig.to_toml())
    record.save(folder / "train.csv")


def environment(python: str) -> dict[str, str]:
    """What a process of this Python sees: another version's modules are its own."""
    return {name: value for name, value in os.environ.items() if python == sys.executable or name != "PYTHONPATH"}


def seconds(python: str, job: str, folder: Path) -> float:
    """Least time of a job in a process of its own."""
    alone = environment(python) | {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "RAYON")}
    pin = ["taskset", "-c", "0"] if sys.platform == "linux" else []
    command = [*pin, python, __file__, str(folder.parent), "--one", job, "--folder", str(folder)]
    done = subprocess.run(command, env=alone, capture_output=True, text=True)
    return float(done.stdout.split()[-1]) if done.returncode == 0 else float("nan")


def growth() -> None:
    """Cost of a fit against periods, and memory of long records of four axes."""
    import numpy as np

    from ambid import Model, Rig, identify, prbs

    rig = Rig.load(Path(__import__("ambid").__file__).parent / "demo" / "data" / "rig.toml")
    model, order, hold = Model(rig), 10, 2
    one_period = prbs(order, amplitude=0.3, hold=hold, axes=len(rig.axes), periods=1, seed=1)
    print(f"{'periods':>8} {'samples':>9} {'load and FFT ms':>16} {'identify ms':>12} {'peak GB':>8}")
    for periods in (2, 4, 8, 16, 32, 64, 512):
        random = np.random.default_rng(periods)
        still = model.simulate(np.tile(one_period, (8, 1)))
        y, i_c = (np.tile(z[-len(one_period) :], (periods, 1)) for z in (still.y, still.i_c))
        y = y + 5e-8 * random.standard_normal(y.shape)
        i_c = i_c + 1e-2 * random.standard_normal(y.shape)
        i_e = np.tile(one_period, (periods, 1))
        record = replace(still, y=y, i_c=i_c, i_e=i_e, period=len(one_period))
        transform = min(_timed(lambda y=y: np.fft.rfft(y, axis=0)) for _ in range(3))
        fit = min(_timed(lambda record=record: identify(rig, record)) for _ in range(3))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(f"{periods:8d} {len(y):9d} {1e3 * transform:16.1f} {1e3 * fit:12.1f} {peak:8.2f}")


def long(axes: int, samples: int, periodic: bool) -> None:
    """Print seconds of the processor and peak of memory [GB] of a fit to a long record."""
    import numpy as np

    from ambid import Model, Rig, identify, prbs

    rig = Rig.load(Path(__import__("ambid").__file__).parent / "demo" / "data" / "rig.toml")
    if axes == 1:
        rig = Rig.load(Path(__file__).parents[1] / "data" / "levitator.toml")
    elif axes == 8:  # another magnet beside each, all of them half as strong
        halved = ("force_current", "force_displacement")
        weak = [b.model_copy(update={k: tuple(0.5 * v for v in getattr(b, k)) for k in halved}) for b in rig.bearings]
        beside = [b.model_copy(update={"name": b.name + "2"}) for b in weak]
        integral = (rig.controller.integral,) * 4 + (0.0,) * 4  # two integrators at one place know no rest
        controller = rig.controller.model_copy(update={"integral": integral})
        rig = rig.replace(bearings=(*weak, *beside), controller=controller)
    random, model = np.random.default_rng(1), Model(rig)
    if periodic:
        period = prbs(10, amplitude=0.1, hold=2, axes=axes, periods=1, seed=1)
        repeats = max(2, samples // len(period))
        settled = model.simulate(np.tile(period, (8, 1)))
        y, i_c = (np.tile(z[-len(period) :], (repeats, 1)) for z in (settled.y, settled.i_c))
        record = replace(settled, y=y, i_c=i_c, i_e=np.tile(period, (repeats, 1)), period=len(period))
    else:
        record = replace(model.simulate(0.1 * random.standard_normal((samples, axes))), period=None)
    y, i_c = np.array(record.y), np.array(record.i_c)
    for own in (*y.T, *i_c.T):
        own += 0.02 * own.std() * random.standard_normal(len(own))
    record = replace(record, y=y, i_c=i_c)
    del y, i_c
    begun = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (int(begun) + MOST_SECONDS, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_MEMORY, resource.RLIM_INFINITY))
    identify(rig, record)
    print(time.process_time() - begun, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)


def measured(python: str, axes: int, samples: int, periodic: bool) -> tuple[str, str]:
    """Seconds and gigabytes of `long`, or why there are none."""
    job = [python, __file__, "--one", f"long {axes} {samples} {int(periodic)}"]
    done = subprocess.run(job, capture_output=True, text=True, env=environment(python) | {"OPENBLAS_NUM_THREADS": "1"})
    if done.returncode == 0:
        return "{:.2f} {:.2f}".format(*map(float, done.stdout.split())).partition(" ")[::2]
    if done.returncode == -signal.SIGXCPU:
        return f"over {MOST_SECONDS}", ""
    if done.returncode == -signal.SIGABRT or "MemoryError" in done.stderr:
        return "", f"over {MOST_MEMORY / 1e9:g}"
    return done.stderr.strip().rpartition("\n")[2][:60], ""


def long_table(sizes: list[float], axes: list[int], pythons: list[str], table: Path | None) -> None:
    """Table of `long`, a line a size, a pair of columns for each version."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from benchmarks.grid import markdown

    rows = []
    head = LONG[: 3 + 2 * len(pythons)]
    print(*(f"{cell:>9}" for cell in head))
    for number, samples, periodic in ((n, int(s), p) for n in axes for s in sizes for p in (True, False)):
        cells = [cell for python in pythons for cell in measured(python, number, samples, periodic)]
        rows.append((number, f"{samples:.0e}".replace("e+0", "e"), "yes" if periodic else "no", *cells))
        print(*(f"{cell:>9}" for cell in rows[-1]), flush=True)
        if table:
            table.write_text(markdown(head, rows))


def _timed(job: Callable[[], object]) -> float:
    begun = time.perf_counter()
    job()
    return time.perf_counter() - begun


def main() -> None:
    """Time the jobs that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path, nargs="?")
    parser.add_argument("--against", help="the Python of an environment that holds another version")
    parser.add_argument("--jobs", nargs="*", default=[], help="parts of names; default: all")
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--long", type=float, nargs="*", default=[], help="numbers of samples")
    parser.add_argument("--axes", type=int, nargs="*", default=[1, 4], choices=(1, 4, 8))
    parser.add_argument("--table", type=Path, help="where --long writes its table in Markdown")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one and given.one.startswith("long "):
        number, samples, periodic = map(int, given.one.split()[1:])
        long(number, samples, bool(periodic))
        return
    if given.one:
        one(given.one, given.folder)
        return
    if given.long:
        pythons = [sys.executable, *([given.against] if given.against else [])]
        long_table(given.long, given.axes, pythons, given.table)
        return
    if given.growth:
        growth()
        return
    if given.cases is None:
        parser.error("say where the cases are, or --growth")
    print(f"{'job':18s} {'this, s':>9s} {'other, s':>9s} {'ratio':>7s}")
    with tempfile.TemporaryDirectory() as scratch:
        for job in (job for job in JOBS if not given.jobs or any(part in job for part in given.jobs)):
            case = job.split()[1]
            folder = Path(scratch) / case
            if case == "turning":
                turning(folder)
            else:
                folder = next(given.cases.glob(f"{case}*"))
            own = seconds(sys.executable, job, folder.resolve())
            other = seconds(given.against, job, folder.resolve()) if given.against else float("nan")
            print(f"{job:18s} {own:9.3f} {other:9.3f} {other / own:7.1f}", flush=True)


if __name__ == "__main__":
    main()
