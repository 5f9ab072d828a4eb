"""What the benchmarks share: runs that go on where their file ends, and rates with their intervals."""

import argparse
import json
import math
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

Row = dict[str, Any]
NORMAL_95 = 1.959964


def wilson(hits: int, runs: int, z: float = NORMAL_95) -> tuple[float, float]:
    """Wilson's interval of a rate, 95 % by default; (0, 1) without runs."""
    if not runs:
        return 0.0, 1.0
    rate, spread = hits / runs, z * z / runs
    middle = (rate + 0.5 * spread) / (1.0 + spread)
    half = z / (1.0 + spread) * math.sqrt(rate * (1.0 - rate) / runs + 0.25 * spread / runs)
    return max(0.0, middle - half), min(1.0, middle + half)


def rate_text(hits: int, runs: int) -> str:
    """Rate and its Wilson 95 % interval in percent, such as ``4/200 = 2.0 % (0.8 .. 5.0)``."""
    low, high = wilson(hits, runs)
    return f"{hits}/{runs} = {100 * hits / max(runs, 1):.1f} % ({100 * low:.1f} .. {100 * high:.1f})"


def options(about: str | None, *, workers: int) -> argparse.ArgumentParser:
    """What every benchmark is asked whose runs go on where their file ends."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=workers)
    parser.add_argument("--report", action="store_true", help="print what the file holds")
    return parser


def read_rows(path: Path) -> list[Row]:
    """Rows of a file of JSON lines; none where there is no file, and not the last one if it was cut off."""
    rows = []
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def run_all(run: Callable[..., Row], jobs: Iterable[tuple], out: Path, workers: int) -> None:
    """Append a row for every job whose key, its arguments as a list, is in no row yet."""
    done = {json.dumps(row["key"]) for row in read_rows(out)}
    todo = [job for job in jobs if json.dumps(list(job)) not in done]
    if out.exists() and out.stat().st_size and not out.read_bytes().endswith(b"\n"):
        with out.open("a") as file:  # a run that was killed while it wrote
            file.write("\n")
    with ProcessPoolExecutor(workers, initializer=threadpool_limits, initargs=(1,)) as pool, out.open("a") as file:
        try:
            for future in as_completed([pool.submit(_keyed, run, job) for job in todo]):
                file.write(json.dumps(future.result(), default=float) + "\n")
                file.flush()
        finally:  # an error ends the run, not what is left of it
            pool.shutdown(cancel_futures=True)


def _keyed(run: Callable[..., Row], job: tuple) -> Row:
    return {"key": list(job), **run(*job)}


def markdown(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table."""
    head = list(head)
    lines = [head, ["---"] * len(head), *([str(cell) for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def aligned(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """The same for a terminal: columns side by side, the first one to the left."""
    lines = [list(head), *([str(cell) for cell in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(c.ljust(w) if not k else c.rjust(w) for k, (c, w) in enumerate(zip(line, widths, strict=True)))
        for line in lines
    )
