"""The uncertain model as files: matrices in a .mat file, and a script that makes a MATLAB uss of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from ambid.errors import ModelError
from ambid.writing import whole_file

SCRIPT = Path(__file__).with_name("uncertain_model.m")


def script_beside(path: Path) -> Path:
    """Where the script of a .mat file is written.

    Raises
    ------
    ModelError
        If the suffix is not .mat, or the name would be none of a MATLAB script.
    """
    if path.suffix.lower() != ".mat":
        raise ModelError(f"{path}: the suffix is {path.suffix or 'missing'}; expected .mat")
    if not re.fullmatch(r"[A-Za-z]\w{0,50}", path.stem, re.ASCII):
        raise ModelError(
            f"{path}: its script would be {path.stem}_uss.m, which MATLAB cannot run; expected a name of letters, "
            "digits and _ that begins with a letter"
        )
    return path.with_name(f"{path.stem}_uss.m")


def write_with_script(content: Mapping[str, Any], path: Path) -> list[Path]:
    """Write variables, a tuple of texts as a cell array, and the script beside them; see `UncertainModel.to_mat`."""
    script = script_beside(path)
    cells = {
        name: np.array(value, dtype=object).reshape(-1, 1) if isinstance(value, tuple) else value
        for name, value in content.items()
    }
    with whole_file(path) as stream:
        scipy.io.savemat(stream, cells, long_field_names=True)
    text = SCRIPT.read_text(encoding="utf-8").replace("FILE.mat", path.name)
    with whole_file(script) as stream:
        stream.write(text.encode())
    return [path, script]
