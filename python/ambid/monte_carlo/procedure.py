"""Monte Carlo: chunk by chunk, here or by an executor, and on from where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from pathlib import Path

from ambid.errors import IdentificationError, InputError, Stopped
from ambid.monte_carlo.chunks import Chunks
from ambid.monte_carlo.plan import Plan
from ambid.monte_carlo.result import MonteCarlo
from ambid.monte_carlo.runs import Row, rows_of

__all__ = ["CHUNK", "run_monte_carlo"]

CHUNK = 64
"""Runs of a chunk: what a killed job loses at most, in a file that is not too small."""


def run_monte_carlo(
    plan: Plan,
    runs: int,
    *,
    out: str | Path | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> MonteCarlo:
    """Simulate, and identify or diagnose, so many runs of a plan.

    A run depends on the plan and on its own number alone: not on how many runs there are, on who makes them, nor on
    what was stopped before.

    Parameters
    ----------
    plan : Plan
    runs : int
    out : str or Path, optional
        Folder ``NAME.parquet`` for the rows; what it holds of this plan is not made again. Needs pyarrow.
    executor : concurrent.futures.Executor, optional
        Makes whole chunks; by default they are made here.
    progress : callable, optional
        Called with the runs that were made, and that were to be made.

    Returns
    -------
    MonteCarlo

    Raises
    ------
    InputError
        If the folder holds something else, or `runs` is no positive number.
    OutputError
        If a chunk cannot be written; those before stay.
    IdentificationError
        If a worker of the executor has gone.
    Stopped
        At Ctrl-C, with the runs that are done; it is a KeyboardInterrupt.
    """
    if runs < 1:
        raise InputError(f"runs = {runs}: expected 1 or more")
    store = None if out is None else Chunks(Path(out), plan)
    numbers = {k: range(k * CHUNK, min(runs, (k + 1) * CHUNK)) for k in range(-(-runs // CHUNK))}
    rows = {k: [] if store is None else store.read(k, range(k * CHUNK, (k + 1) * CHUNK)) for k in numbers}
    left = {k: list(own[len(rows[k]) :]) for k, own in numbers.items() if len(rows[k]) < len(own)}
    total = sum(map(len, left.values()))
    made = 0

    def tell(more: int) -> None:
        if progress is not None:
            progress(made + more, total)

    def keep(chunk: int, more: list[Row]) -> None:
        nonlocal made
        rows[chunk] += more
        made += len(more)
        if store is not None and more:
            store.write(chunk, rows[chunk])

    def result() -> MonteCarlo:
        return MonteCarlo.of(plan, [row for k in sorted(rows) for row in rows[k] if row["run"] < runs])

    tell(0)
    try:
        if executor is None:
            for chunk, own in left.items():
                try:
                    keep(chunk, rows_of(plan, own, tell))
                except Stopped as stopped:
                    keep(chunk, stopped.result)  # type: ignore[arg-type]
                    raise
        else:
            for chunk, more in _by(executor, plan, left):
                keep(chunk, more)
                tell(0)
    except KeyboardInterrupt:
        raise Stopped(result()) from None
    except BrokenExecutor as error:
        where = "are lost" if out is None else f"stay in {out}; do the same again to go on"
        raise IdentificationError(
            f"a worker has gone, killed or out of memory ({error}); the {made} runs made by now {where}"
        ) from None
    return result()


def _by(executor: Executor, plan: Plan, left: dict[int, list[int]]) -> Iterator[tuple[int, list[Row]]]:
    """Chunks as an executor ends them; those not begun are called off when they are no longer wanted."""
    futures: dict[Future[list[Row]], int] = {}
    try:
        for chunk, own in left.items():
            futures[executor.submit(rows_of, plan, own)] = chunk
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()
