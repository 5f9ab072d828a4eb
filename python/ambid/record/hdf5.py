"""Records in HDF5 files, those of MATLAB v7.3 among them: only what is asked for is read, and no link is left."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.reading import MOST_COLUMNS, require_size
from ambid.record.content import Content, Stored

EXTERNAL_LINK = Kind("external_link", "warning", "{name}: leads to another file, and is not followed")

DEEPEST = 32
"""Groups within each other; files of loggers have three."""
MOST_AXES = 64
"""Names in ``axes``; a machine has some ten, and each is looked up by itself."""
_MATLAB_OWN = ("#refs#", "#subsystem#")


@contextmanager
def read_hdf5(path: Path, h5py: Any) -> Iterator[Content]:
    """What an HDF5 file holds, while it is open; `h5py` is the package."""
    is_mat = path.suffix.lower() == ".mat"
    with h5py.File(path, "r", locking=False) as file:
        content = Content({})
        for name, dataset in _datasets(path, h5py, file, "." if is_mat else "/", content.findings):
            # MATLAB stores column by column: its arrays are turned in HDF5's view.
            content.arrays[name] = _stored(path, name, dataset, "MATLAB_class" in dataset.attrs or is_mat)
        if "axes" in content.arrays:
            content.axes = _names(path, file, file["axes"])
        yield content


def _datasets(path: Path, h5py: Any, file: Any, joint: str, findings: list[Finding]) -> Iterator[tuple[str, Any]]:
    """All sets of a file, each group entered once: hard links may lead back to a group that holds them."""
    seen, found, waiting = {file["/"]}, 0, [("", file["/"], 0)]
    while waiting:
        prefix, group, depth = waiting.pop()
        inner = []
        for name in group:
            found += 1
            if found > MOST_COLUMNS:
                raise RecordError(f"{path}: more than {MOST_COLUMNS} groups and sets; save those of the record alone")
            if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
                findings.append(EXTERNAL_LINK(name=f"{prefix}{name}"))
                continue
            item = group.get(name)
            if isinstance(item, h5py.Dataset):
                yield f"{prefix}{name}", item
            elif isinstance(item, h5py.Group) and name not in _MATLAB_OWN and item not in seen:
                if depth == DEEPEST:
                    raise RecordError(f"{path}: groups nested deeper than {DEEPEST}; save the record flat")
                seen.add(item)
                inner.append((f"{prefix}{name}{joint}", item, depth + 1))
        waiting += reversed(inner)


def _stored(path: Path, name: str, dataset: Any, is_turned: bool) -> Stored:
    shape = dataset.shape or ()

    def read() -> NDArray[Any]:
        if dataset.is_virtual or dataset.external:
            raise RecordError(f"{path}: {name} holds its values in other files, which are not read; save them in one")
        require_size(path, name, shape, dataset.dtype.itemsize, dataset.id.get_storage_size())
        values = dataset[()]
        return values.T if is_turned else values

    return Stored(shape[::-1] if is_turned else shape, dataset.dtype, read)


def _names(path: Path, file: Any, dataset: Any) -> list[Any]:
    """Strings of an HDF5 string array, or of a MATLAB v7.3 cell array (references to rows of character codes)."""
    if dataset.dtype.kind == "u":
        return ["".join(map(chr, row)) for row in np.atleast_2d(_letters(path, dataset).T)]
    if dataset.size is None or dataset.size > MOST_AXES:
        raise RecordError(f"{path}: 'axes' has the shape {dataset.shape}; give the names of at most {MOST_AXES} axes")
    cells = list(np.ravel(dataset[()]))
    if dataset.dtype.kind == "O" and dataset.attrs.get("MATLAB_class", b"cell") == b"cell":
        return [c if isinstance(c, bytes) else "".join(map(chr, np.ravel(_letters(path, file[c])))) for c in cells]
    return cells


def _letters(path: Path, dataset: Any) -> NDArray[Any]:
    if dataset.dtype.kind != "u" or not 0 < dataset.size <= MOST_AXES * 200:  # letters in a name of ``axes``
        raise RecordError(
            f"{path}: 'axes' leads to {dataset.dtype} of shape {dataset.shape}; give each axis as a line of letters"
        )
    return np.asarray(dataset[()])
