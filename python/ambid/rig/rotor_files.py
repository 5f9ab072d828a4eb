"""The matrices of a rotor out of an `.npz` or `.mat` file."""

import math
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.io.matlab import matfile_version
from scipy.sparse import issparse

from ambid.reading import load_mat
from ambid.rig.fields import problem, refuse

MATRIX_KEYS = ("node_positions", "M", "K", "G", "C")
MOST_NODES = 400
"""Nodes of a rotor given as matrices: the four then hold ten million numbers, a third of a gigabyte to read."""


def matrices_of_file(path: Path, name: str | Path) -> dict[str, Any]:
    """Read the keys of a `MatrixRotor` from an `.npz` or `.mat` file, as nested lists."""
    matrices: dict[str, NDArray[np.float64]] = {}
    try:
        if path.suffix != ".npz" and matfile_version(path)[0] == 2:  # HDF5
            refuse(problem("MATLAB v7.3 is not read here; save it with the option -v7, or as .npz.", name, "file"))
        content = _arrays(path) if path.suffix == ".npz" else load_mat(path)
        for key in content.keys() & set(MATRIX_KEYS):
            value = content[key]
            if math.prod(np.shape(value)) > (4 * MOST_NODES) ** 2:
                text = f"{key} has the shape {np.shape(value)}; expected {MOST_NODES} nodes or fewer."
                refuse(problem(text, name, "file"))
            if issparse(value):
                value.check_format(full_check=True)  # a wrong index would be written to, wherever it points
                value = value.toarray()
            matrices[key] = np.asarray(value, dtype=float)
    except OSError as error:
        refuse(problem(f"cannot be read ({error.strerror}); give the path relative to the rig file.", name, "file"))
    except ValidationError:
        raise
    except Exception:  # a damaged byte leads the parsers to any at all
        text = (
            f"cannot be read; expected a whole {path.suffix} file with the arrays {', '.join(MATRIX_KEYS)} of numbers."
        )
        refuse(problem(text, name, "file"))
    return {key: (v.ravel() if key == "node_positions" else v).tolist() for key, v in matrices.items()}


def _arrays(path: Path) -> dict[str, Any]:
    """Arrays of an `.npz` file; it may be compressed, but not expand to more than matrices are."""
    with ZipFile(path) as packed:
        if any(entry.file_size > 9 * (4 * MOST_NODES) ** 2 for entry in packed.infolist()):
            raise ValueError
    with np.load(path) as content:
        return {key: content[key] for key in content.files if key in MATRIX_KEYS}
