"""Damaged files and odd options by the thousand: `python tests/fuzz/run.py --inputs 5000 --seed 1`.

Every input is made of a seed and a number, and runs in a process of a pool, whose memory and time are bounded.
"""

import argparse
import json
import os
import selectors
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz import inputs
from fuzz.bases import healthy

LONGEST = 10.0
"""Seconds of work on an input; healthy ones take a tenth of one."""
WAITING = 6.0
"""Seconds on the clock for each of work: an input that sleeps hangs too, and a busy machine is no fault of it."""
RENEWED = 250
"""Inputs of a process: what libraries leak of damaged files, some megabytes each, stays far below its bound."""
FINE = ("exit 0", "exit 1", "exit 2", "exit 130")


@dataclass
class Verdict:
    """How an input ended; `outcome` is one of `FINE` where nothing is wrong."""

    number: int
    kind: str
    outcome: str
    detail: str
    seconds: float

    @property
    def is_fine(self) -> bool:
        return self.outcome in FINE


class Worker:
    """A process that runs inputs; started again when one kills it, and when it has run many."""

    def __init__(self, seed: int, bases: Path, folder: Path, longest: float) -> None:
        self.longest = longest
        self._words = [sys.executable, str(Path(__file__).with_name("worker.py")), str(seed), str(bases), str(folder)]
        self._errors = folder.with_suffix(".stderr")
        self.number = -1
        self.start()

    def start(self) -> None:
        self.given = 0
        paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
        # the limit is one of addresses, of which Arrow's own pool would reserve 1 GB, and every heap of a thread 64 MB
        alone = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}
        environment = os.environ | alone | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        with self._errors.open("wb") as errors:
            self.process = subprocess.Popen(
                self._words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
            )

    def give(self, number: int) -> None:
        assert self.process.stdin is not None
        self.number, self.begun, self.given = number, time.monotonic(), self.given + 1
        self.before = self.worked
        self.process.stdin.write(f"{number}\n")
        self.process.stdin.flush()

    @property
    def worked(self) -> float:
        """Seconds that the process has worked."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    @property
    def hangs(self) -> bool:
        """Whether its input takes too long; the first one of a process also waits for its imports."""
        longest = self.longest * (4 if self.given == 1 else 1)
        return self.worked - self.before > longest or time.monotonic() - self.begun > WAITING * longest

    def end(self) -> str:
        """Kill it; what it last said."""
        self.process.kill()
        self.process.wait()
        return self._errors.read_text(errors="replace")[-2000:]


def verdicts(
    seed: int, numbers: Iterable[int], folder: Path, workers: int, longest: float = LONGEST
) -> Iterator[Verdict]:
    """Run inputs in a pool of processes."""
    bases = folder / "healthy"
    if not bases.exists():
        healthy(bases)
    waiting = iter(numbers)
    pool = [Worker(seed, bases, folder / f"worker_{k}", longest) for k in range(workers)]
    with selectors.DefaultSelector() as selector:
        for worker in pool:
            _next(worker, waiting, selector)
        while selector.get_map():
            for key, _ in selector.select(timeout=0.5):
                worker = key.data
                selector.unregister(key.fileobj)
                line = worker.process.stdout.readline()
                if line:
                    kind, outcome, detail, seconds, _ = json.loads(line)
                    yield Verdict(worker.number, kind, outcome, detail, seconds)
                    if worker.given == RENEWED:
                        worker.end()
                        worker.start()
                else:
                    worker.process.wait()
                    yield _lost(worker, seed, bases, folder, f"crash {worker.process.returncode}")
                    worker.start()
                _next(worker, waiting, selector)
            for worker in [key.data for key in selector.get_map().values()]:
                if worker.hangs:
                    selector.unregister(worker.process.stdout)
                    yield _lost(worker, seed, bases, folder, "hang")
                    worker.start()
                    _next(worker, waiting, selector)
    for worker in pool:
        worker.end()


def _next(worker: Worker, waiting: Iterator[int], selector: selectors.BaseSelector) -> None:
    number = next(waiting, None)
    if number is not None:
        worker.give(number)
        selector.register(worker.process.stdout, selectors.EVENT_READ, worker)


def _lost(worker: Worker, seed: int, bases: Path, folder: Path, outcome: str) -> Verdict:
    said = worker.end()
    made = inputs.make(seed, worker.number, bases, folder / "lost")
    return Verdict(
        worker.number, made.kind, outcome, f"{' '.join(made.words)}: {said}", time.monotonic() - worker.begun
    )


def keep(seed: int, verdict: Verdict, bases: Path, folder: Path) -> Path:
    """Write the files and the command of an input that failed."""
    place = folder / f"{seed}_{verdict.number}"
    made = inputs.make(seed, verdict.number, bases, place)
    (place / "input.json").write_text(inputs.description(made))
    return place


def table(found: list[Verdict]) -> str:
    """Kinds of damage against outcomes, and the longest time of each."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for verdict in found:
        counts[verdict.kind][verdict.outcome] += 1
    outcomes = sorted({v.outcome for v in found} | set(FINE), key=lambda o: (o not in FINE, o))
    rows = [f"{'kind':24s}" + "".join(f"{o:>12s}" for o in outcomes) + f"{'longest [s]':>14s}"]
    for kind in [*sorted(counts), "all"]:
        own = sum(counts.values(), Counter()) if kind == "all" else counts[kind]
        longest = max(v.seconds for v in found if kind in (v.kind, "all"))
        rows.append(f"{kind:24s}" + "".join(f"{own[o]:12d}" for o in outcomes) + f"{longest:14.2f}")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="Number of the first input.")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="Folder for inputs that failed.")
    parser.add_argument("--tell", action="store_true", help="Print also what was said of bad input.")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder, found, begun = Path(temporary), [], time.monotonic()
        for verdict in verdicts(given.seed, range(given.first, given.first + given.inputs), folder, given.workers):
            found.append(verdict)
            if given.tell and verdict.detail and verdict.is_fine:
                print(f"{verdict.number}: {verdict.kind}: {verdict.outcome}: {verdict.detail}")
            if not verdict.is_fine:
                place = keep(given.seed, verdict, folder / "healthy", given.keep)
                print(f"{place}: {verdict.kind}: {verdict.outcome}: {verdict.detail}", flush=True)
    print(table(found))
    print(f"{len(found)} inputs of seed {given.seed} in {time.monotonic() - begun:.0f} s")
    sys.exit(any(not verdict.is_fine for verdict in found))


if __name__ == "__main__":
    main()
