"""Rows on the disk: a folder of Parquet files, a chunk of runs each, that a stopped job goes on with."""

import json
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ambid.errors import InputError
from ambid.monte_carlo.plan import Plan
from ambid.monte_carlo.runs import Row, columns
from ambid.writing import make_folder, whole_file

PLAN = "_plan.json"
"""What the rows belong to; readers of Parquet folders pass over names that begin so."""
PART = "part-{:06d}.parquet"


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
