"""The file formats of frequency responses, CSV, MATLAB and Universal File Format 58, read into named arrays."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ambid.errors import RecordError
from ambid.reading import reading, variables_of, watched
from ambid.record.channel_map import ChannelMap
from ambid.record.content import VARIABLES_NOT_USED, unused
from ambid.record.quantities import OURS, hz_of, values_of
from ambid.record.raw_response import RawResponse
from ambid.record.readers import flatten_cells, opened, require_content
from ambid.record.response_table import is_response_table, read_response_table
from ambid.record.universal import UNIVERSAL, read_universal
from ambid.rig import Rig

FREQUENCIES = ("frequency_hz", "frequency_rad_s", "frequency_rpm")


def holds_response(path: Path, mapping: ChannelMap | None = None) -> bool:
    """Whether a file holds frequency responses rather than signals over time."""
    suffix = path.suffix.lower()
    if suffix in UNIVERSAL:
        return True
    if not path.is_file():
        return False
    if suffix == ".csv":
        return is_response_table(path, mapping)
    if suffix == ".mat":
        with reading(path, RecordError, "a readable .mat file", "save it again"):
            return any(variable.name in FREQUENCIES for variable in variables_of(path) or [])
    return False


def read_response(path: Path, mapping: ChannelMap | None = None, rig: Rig | None = None) -> RawResponse:
    """Read a file in the format that its suffix names.

    Parameters
    ----------
    path : Path
    mapping : ChannelMap, optional
        Names and factors of channels, and columns of a table.
    rig : Rig, optional
        Its one axis is that of a table without names, and its command is in A or V.

    Raises
    ------
    RecordError
        If the file is missing, empty or damaged, or a row or key is wrong.
    InputError
        If the format needs a package that is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".mat", *UNIVERSAL):
        raise RecordError(
            f"{path}: suffix {path.suffix!r} is no format of frequency responses; use one of .csv, .mat, "
            f"{', '.join(UNIVERSAL)}"
        )
    require_content(path)
    with reading(path, RecordError, f"a readable {suffix} file", "save it again"), watched(path, RecordError) as found:
        if suffix == ".csv":
            raw = read_response_table(path, mapping, () if rig is None else rig.axes)
        else:
            raw = _from_mat(path) if suffix == ".mat" else read_universal(path, mapping, rig)
        raw = replace(raw, provenance=found)
    return raw if mapping is None else raw.mapped(path, mapping)


def _from_mat(path: Path) -> RawResponse:
    with opened(path) as content:
        held = content.arrays
        frequency = next((name for name in FREQUENCIES if name in held), FREQUENCIES[0])
        forms = (("magnitude", "magnitude_db"), ("phase_deg", "phase_rad"))
        size, angle = (next((name for name in own if name in held), "") for own in forms)
        given = ("response",) if "response" in held or not (size and angle) else (size, angle)
        missing = [name for name in (frequency, *given, "outputs", "inputs") if name not in held]
        if missing:
            raise RecordError(f"{path}: no variable {', '.join(missing)}; the variables are {', '.join(held)}")
        names = {}
        for key in ("outputs", "inputs"):
            cells = flatten_cells(np.asarray(held[key]))
            if not all(isinstance(cell, str) for cell in cells):
                raise RecordError(
                    f"{path}: {key} holds no names; save a cell array such as {{'y.A_zeta', 'i_c.A_zeta'}}"
                )
            names[key] = [cell.strip() for cell in cells]
        f = _array(path, frequency, held[frequency], np.float64).ravel()
        shape = (len(f), len(names["outputs"]), len(names["inputs"]))
        pairs = shape[1] * shape[2]
        found: dict[str, Any] = {}
        for key in (*given, "std", "coherence", "covariance"):
            if key not in held:
                continue
            own = _array(path, key, held[key], np.complex128 if key in ("response", "covariance") else np.float64)
            wanted = (len(f), pairs, pairs) if key == "covariance" else shape
            if own.size != np.prod(wanted) or own.shape[0] != len(f):  # MATLAB drops last dimensions of one
                raise RecordError(
                    f"{path}: {key} has the shape {own.shape}; {len(f)} frequencies, {shape[1]} outputs and {shape[2]} "
                    f"inputs make it {wanted}"
                )
            found[key] = own.reshape(wanted)
        for key in ("averages", "spread"):
            if key in held:
                found[key] = float(_array(path, key, held[key], np.float64).ravel()[0])
        used = {frequency, "outputs", "inputs", *found}
        left_out = unused(VARIABLES_NOT_USED, (name for name in held if name not in used))
        if given != ("response",):
            own = {key: (name, OURS[name]) for key, name in (("magnitude", size), ("phase", angle))}
            values = {key: found.pop(name) for key, (name, _) in own.items()}
            found["response"], _ = values_of(path, own, values, names["outputs"])
        f, _ = hz_of(path, frequency, OURS[frequency], f)
    return RawResponse(f, names["outputs"], names["inputs"], **found, findings=left_out)


def _array(path: Path, key: str, value: Any, kind: Any) -> Any:
    array = np.asarray(value)
    if array.dtype.kind not in ("iufc" if kind is np.complex128 else "iuf") or array.size == 0:
        raise RecordError(f"{path}: {key} holds {array.dtype} of shape {array.shape}; give numbers")
    return array.astype(kind)
