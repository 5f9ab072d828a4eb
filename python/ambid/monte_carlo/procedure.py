"""Monte Carlo: runs made here or by an executor, sorted into chunks, and on from where it was stopped.

Chunks may be on the disk: a folder of Parquet files, which a stopped job goes on with.
"""

import json
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import closing
from importlib.util import find_spec
from itertools import count, takewhile
from pathlib import Path
from typing import Any

from ambid.errors import IdentificationError, InputError, Stopped
from ambid.monte_carlo.executors import made_by
from ambid.monte_carlo.plan import Plan
from ambid.monte_carlo.result import MonteCarlo
from ambid.monte_carlo.runs import Row, columns, rows_of
from ambid.writing import make_folder, whole_file

CHUNK = 64
"""Runs of a chunk: what a killed job loses at most, in a file that is not too small."""
BATCH = 16
"""Identifications of a task: a second of work or so, to which sending it adds milliseconds. A diagnosis is one."""
MOST_RUNS = 10_000_000
"""Runs of a plan: their rows are kept for what is reported of all, a kilobyte or so each."""
PLAN = "_plan.json"
"""What the rows belong to; readers of Parquet folders pass over names that begin so."""
PART = "part-{:06d}.parquet"


def run_monte_carlo(
    plan: Plan,
    runs: int,
    *,
    out: str | Path | None = None,
    executor: Any = None,
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
    executor : object, optional
        Makes the runs, a few in a task, in whatever order; by default they are made here. A client of dask distributed,
        or its executor; or anything with a ``submit`` that returns futures of `concurrent.futures`, such as the
        executors of that module and of mpi4py.futures; or with a ``map``, whose rows are kept as it yields them. The
        plan is sent to dask once; other executors send it with every task, unless `hold_plan` is their initializer.
    progress : callable, optional
        Called with the runs that were made, and that were to be made.

    Returns
    -------
    MonteCarlo

    Raises
    ------
    InputError
        If the folder holds something else, `runs` is none from 1 to `MOST_RUNS`, or the executor is none.
    OutputError
        If a chunk cannot be written; those before stay.
    IdentificationError
        If a worker of the executor has gone, or the scheduler of the cluster.
    Stopped
        At Ctrl-C, with the runs that are done; it is a KeyboardInterrupt.
    """
    if not 1 <= runs <= MOST_RUNS:
        raise InputError(f"runs = {runs}: expected 1 to {MOST_RUNS}")
    rows = _Rows(runs, None if out is None else Chunks(Path(out), plan))
    left = rows.left()
    total = sum(map(len, left))
    made = 0

    def report(more: int) -> None:
        if progress is not None:
            progress(made + more, total)

    report(0)
    coming: Generator[list[Row]]
    try:
        if executor is None:
            coming = (rows_of(plan, own, report) for own in left)
        else:
            coming = made_by(executor, plan, list(_batches(left, 1 if plan.diagnose else BATCH)))
        with closing(coming):  # whatever ends it, no task is left with the executor
            for more in coming:
                rows.add(more)
                made += len(more)
                report(0)
    except KeyboardInterrupt as early:
        if isinstance(early, Stopped):
            rows.add(early.result)  # type: ignore[arg-type]
        rows.write_begun()
        raise Stopped(MonteCarlo.of(plan, rows.in_order())) from None
    except BrokenExecutor as error:
        rows.write_begun()
        there = "before are lost" if out is None else f"before stay in {out}; do the same again to go on"
        raise IdentificationError(
            f"a worker or the scheduler has gone, killed or out of memory ({error}); the {made} runs made {there}"
        ) from None
    return MonteCarlo.of(plan, rows.in_order())


def _batches(left: Sequence[Sequence[int]], size: int) -> Iterator[Sequence[int]]:
    for own in left:
        for first in range(0, len(own), size):
            yield own[first : first + size]


class Chunks:
    """A folder ``NAME.parquet`` that pandas, pyarrow and others read as one table.

    A file appears in it when it is whole, so that a killed job loses the runs of one chunk at most.

    Parameters
    ----------
    folder : Path
    plan : Plan

    Raises
    ------
    InputError
        If the folder holds something else, or the rows of another plan.
    OutputError
        If it cannot be made or written.
    """

    def __init__(self, folder: Path, plan: Plan) -> None:
        require_folder(folder)
        self.folder, self.plan = folder, plan
        make_folder(folder)
        own, place = plan.content(), folder / PLAN
        if not place.exists():
            with whole_file(place) as stream:
                stream.write((json.dumps(own, indent=1, sort_keys=True) + "\n").encode())
            return
        found = _plan_of(place)
        if other := sorted(key for key in {*own, *found} if own.get(key) != found.get(key)):
            raise InputError(
                f"{folder}: holds the runs of another plan, which differs in {', '.join(other)}; give another folder, "
                "or delete this one"
            )

    def read(self, chunk: int, runs: Sequence[int]) -> list[Row]:
        """The rows of a chunk that are there, those of its first runs."""
        path = self.folder / PART.format(chunk)
        if not path.exists():
            return []
        import pyarrow
        import pyarrow.parquet

        try:
            with pyarrow.parquet.ParquetFile(path, pre_buffer=False) as file:
                rows = file.read(use_threads=False).to_pylist()
        except (pyarrow.ArrowException, OSError) as error:
            raise InputError(f"{path}: cannot be read ({error}); delete it, and its runs are made again") from None
        if [row.get("run") for row in rows] != list(runs)[: len(rows)]:
            raise InputError(f"{path}: holds other runs than those of its place; delete it, and they are made again")
        return list(rows)

    def write(self, chunk: int, rows: Sequence[Row]) -> None:
        """Put the rows of a chunk in the place of those that are there."""
        import pyarrow
        import pyarrow.parquet

        kinds = {int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string(), bool: pyarrow.bool_()}
        schema = pyarrow.schema([(name, kinds[kind]) for name, kind in columns(self.plan).items()])
        table = pyarrow.Table.from_pylist(list(rows), schema)
        with whole_file(self.folder / PART.format(chunk)) as stream:
            pyarrow.parquet.write_table(table, stream)


def require_folder(folder: Path) -> None:
    """Refuse what is no place for chunks, before any work is done.

    Raises
    ------
    InputError
        If pyarrow is not there, the name has another suffix, or something else is in its place.
    """
    if find_spec("pyarrow") is None:
        raise InputError(f"{folder}: Parquet needs the package pyarrow: pip install 'ambid[io]'")
    if folder.suffix.lower() != ".parquet":
        raise InputError(f"{folder}: the suffix is {folder.suffix or 'missing'}; expected .parquet")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: a file is there; the runs go into a folder of this name, give another one")
    if folder.is_dir() and not (folder / PLAN).exists() and any(not p.name.startswith(".") for p in folder.iterdir()):
        raise InputError(f"{folder}: holds files, but no {PLAN} of runs to go on with; give another folder")


def _plan_of(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); delete its folder, or give another") from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: is no plan of runs; delete its folder, or give another")
    return found


class _Rows:
    """Rows by chunk, whatever order they come in; a chunk is written when it is whole."""

    def __init__(self, runs: int, store: Chunks | None) -> None:
        self._store = store
        self._wanted = [range(first, min(runs, first + CHUNK)) for first in range(0, runs, CHUNK)]
        self._there: list[dict[int, Row]] = [{} for _ in self._wanted]
        if store is not None:
            for chunk, own in enumerate(self._wanted):
                found = store.read(chunk, range(own.start, own.start + CHUNK))
                self._there[chunk] = {row["run"]: row for row in found}
        self._written = [len(own) for own in self._there]

    def left(self) -> list[Sequence[int]]:
        """The runs of each chunk that are still to be made, where there are any."""
        left = (own[there:] for own, there in zip(self._wanted, self._written, strict=True))
        return [own for own in left if own]

    def add(self, rows: Sequence[Row]) -> None:
        touched = {row["run"] // CHUNK for row in rows}
        for row in rows:
            self._there[row["run"] // CHUNK][row["run"]] = row
        for chunk in touched:
            if len(self._there[chunk]) >= len(self._wanted[chunk]):
                self._write(chunk)

    def write_begun(self) -> None:
        """Write the chunks that are not whole, up to their first run that is missing; what came after it is lost."""
        for chunk in range(len(self._wanted)):
            if len(self._first(chunk)) > self._written[chunk]:
                self._write(chunk)

    def in_order(self) -> list[Row]:
        """The wanted rows, of each chunk those that are or would be written."""
        return [row for chunk, own in enumerate(self._wanted) for row in self._first(chunk)[: len(own)]]

    def _first(self, chunk: int) -> list[Row]:
        there = self._there[chunk]
        return [there[run] for run in takewhile(there.__contains__, count(self._wanted[chunk].start))]

    def _write(self, chunk: int) -> None:
        rows = self._first(chunk)
        if self._store is not None:
            self._store.write(chunk, rows)
        self._written[chunk] = len(rows)
