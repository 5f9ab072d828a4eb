"""The file formats of frequency responses, CSV, MATLAB and Universal File Format 58, read into named arrays."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.reading import Provenance, reading, variables_of, watched
from ambid.record.channel_map import ChannelMap
from ambid.record.content import CHANNELS_NOT_USED, COLUMNS_NOT_USED, VARIABLES_NOT_USED, unused
from ambid.record.readers import extra, flatten_cells, opened, require_content

__all__ = ["RawResponse", "holds_response", "read_response"]

COLUMNS = ("frequency_hz", "output", "input", "re", "im")
FURTHER = ("std", "coherence", "averages", "spread")
COVARIANCE = ("cov_re", "cov_im")
"""Of a row's error with that of the pair that the column names beside it, at the same frequency: real and imaginary."""
UNIVERSAL = (".uff", ".unv")
FRF, COHERENCE = 4, 6
"""Types of functions of the sets 58."""
SETS_NOT_READ = Kind("sets_not_read", "note", "{count} sets are no frequency responses, and were not read")
DIRECTIONS = {0: "", 1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}


@dataclass
class RawResponse:
    """What a file holds, before any check; tables of shape (F, outputs, inputs), NaN where it is silent."""

    frequency_hz: FloatArray
    outputs: list[str]
    inputs: list[str]
    response: ComplexArray
    std: FloatArray | None = None
    coherence: FloatArray | None = None
    averages: float | None = None
    covariance: ComplexArray | None = None
    spread: float | None = None
    findings: list[Finding] = field(default_factory=list)
    provenance: Provenance | None = None

    def mapped(self, path: Path, mapping: ChannelMap) -> RawResponse:
        """The same with the names and units of a map; channels that it does not name are left out, with a finding.

        Raises
        ------
        RecordError
            If a channel of the map is not there.
        """
        kept, names, factors, left_out = {}, {}, {}, []
        for kind, own in (("outputs", self.outputs), ("inputs", self.inputs)):
            found = {name: mapping.channel_of(name) for name in own}
            kept[kind] = [k for k, name in enumerate(own) if found[name] is not None]
            told = [channel for name in own if (channel := found[name]) is not None]
            names[kind], factors[kind] = [name for name, _ in told], np.array([factor for _, factor in told])
            left_out += [name for name in own if found[name] is None]
        missing = [c for c in mapping.channels if c not in (*names["outputs"], *names["inputs"])]
        if missing:
            present = ", ".join((*self.outputs, *self.inputs))
            raise RecordError(f"{path}: map {missing[0]}: there is no such channel; the channels are {present}")
        scale = factors["outputs"][:, None] / factors["inputs"]
        chosen = np.ix_(range(len(self.frequency_hz)), kept["outputs"], kept["inputs"])
        flat = [o * len(self.inputs) + i for o in kept["outputs"] for i in kept["inputs"]]
        covariance = None
        if self.covariance is not None:
            covariance = self.covariance[:, flat][:, :, flat] * np.outer(scale, scale)
        return replace(
            self,
            outputs=names["outputs"],
            inputs=names["inputs"],
            response=self.response[chosen] * scale,
            std=None if self.std is None else self.std[chosen] * np.abs(scale),
            coherence=None if self.coherence is None else self.coherence[chosen],
            covariance=covariance,
            findings=[*self.findings, *unused(CHANNELS_NOT_USED, left_out)],
            provenance=self.provenance,
        )


def holds_response(path: Path) -> bool:
    """Whether a file holds frequency responses rather than signals over time."""
    suffix = path.suffix.lower()
    if suffix in UNIVERSAL:
        return True
    if not path.is_file():
        return False
    if suffix == ".csv":
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            return "frequency_hz" in file.readline(1 << 12)
    if suffix == ".mat":
        with reading(path, RecordError, "a readable .mat file", "save it again"):
            return "frequency_hz" in [variable.name for variable in variables_of(path) or []]
    return False


def read_response(path: Path) -> RawResponse:
    """Read a file in the format that its suffix names.

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
    reader = {".csv": _from_csv, ".mat": _from_mat}.get(suffix, _from_universal)
    with reading(path, RecordError, f"a readable {suffix} file", "save it again"), watched(path, RecordError) as found:
        return replace(reader(path), provenance=found)


def _from_csv(path: Path) -> RawResponse:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            separator = max(",;\t", key=file.readline().count)
            file.seek(0)
            rows = [row for row in csv.reader(file, delimiter=separator) if row]
    except (UnicodeDecodeError, csv.Error):
        raise RecordError(f"{path}: not a text file; give comma-separated text in UTF-8") from None
    header = [name.strip() for name in rows[0]]
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise RecordError(f"{path}: no column {', '.join(missing)}; the columns are {', '.join(header)}")
    if len(rows) == 1:
        raise RecordError(f"{path}: a header without rows; measure again")
    known = (*COLUMNS, *FURTHER, *(name for name in header if name.startswith(COVARIANCE)))
    at = {name: header.index(name) for name in known if name in header}
    places: dict[tuple[float, str, str], dict[str, float]] = {}
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(header):
            raise RecordError(f"{path}: row {number} has {len(row)} cells, the header {len(header)}; complete it")
        cells = {name: row[k].strip() for name, k in at.items()}
        values = {n: _number(path, n, number, cell) for n, cell in cells.items() if n not in ("output", "input")}
        if not np.isfinite(values["frequency_hz"]):
            raise RecordError(f"{path}: frequency_hz is {values['frequency_hz']} in row {number}; give Hz, above 0")
        key = (values["frequency_hz"], cells["output"], cells["input"])
        if key in places:
            what = f"{key[1]} / {key[2]} at {key[0]:g} Hz"
            raise RecordError(f"{path}: row {number}: {what} is there already; keep one of the two")
        places[key] = values
    raw = _tabled(places)
    pairs = [f"{output} / {inlet}" for output in raw.outputs for inlet in raw.inputs]
    used = {*COLUMNS, *FURTHER, *(f"{part} {pair}" for part in COVARIANCE for pair in pairs)}
    raw.findings = unused(COLUMNS_NOT_USED, (name for name in header if name not in used))
    return raw


def _number(path: Path, name: str, row: int, cell: str) -> float:
    """A cell; NaN where one that may be empty is."""
    if not cell and name not in COLUMNS:
        return np.nan
    try:
        return float(cell)
    except ValueError:
        raise RecordError(f"{path}: {name}, row {row}: {cell!r} is not a number; correct the cell") from None


def _tabled(places: dict[tuple[float, str, str], dict[str, float]]) -> RawResponse:
    """Tables from values by frequency, output and input."""
    f = np.unique([key[0] for key in places])
    outputs = list(dict.fromkeys(output for _, output, _ in places))
    inputs = list(dict.fromkeys(inlet for _, _, inlet in places))
    names = ("re", "im", *FURTHER)
    table = np.full((len(names), len(f), len(outputs), len(inputs)), np.nan)
    where = {value: k for k, value in enumerate(f.tolist())}
    rows, columns = ({name: k for k, name in enumerate(own)} for own in (outputs, inputs))
    for (frequency, output, inlet), values in places.items():
        own = [values.get(name, np.nan) for name in names]
        table[:, where[frequency], rows[output], columns[inlet]] = own
    covariance = np.full((len(f), table[0, 0].size, table[0, 0].size), np.nan, dtype=complex)
    beside = [[f"{part} {output} / {inlet}" for part in COVARIANCE] for output in outputs for inlet in inputs]
    for (frequency, output, inlet), values in places.items():
        cells = [complex(values.get(re, np.nan), values.get(im, np.nan)) for re, im in beside]
        covariance[where[frequency], rows[output] * len(inputs) + columns[inlet]] = cells
    covariance = np.where(np.isnan(covariance), covariance.conj().transpose(0, 2, 1), covariance)
    averages, spread = (float(np.median(own)) if len(own := one[np.isfinite(one)]) else None for one in table[4:])
    return RawResponse(
        f,
        outputs,
        inputs,
        table[0] + 1j * table[1],
        table[2],
        table[3],
        averages,
        None if np.isnan(covariance).all() else covariance,
        spread,
    )


def _from_mat(path: Path) -> RawResponse:
    with opened(path) as content:
        held = content.arrays
        missing = [name for name in ("frequency_hz", "response", "outputs", "inputs") if name not in held]
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
        f = _array(path, "frequency_hz", held["frequency_hz"], np.float64).ravel()
        shape = (len(f), len(names["outputs"]), len(names["inputs"]))
        pairs = shape[1] * shape[2]
        found: dict[str, Any] = {}
        for key in ("response", "std", "coherence", "covariance"):
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
        left_out = unused(
            VARIABLES_NOT_USED, (n for n in held if n not in ("frequency_hz", "outputs", "inputs", *found))
        )
    return RawResponse(f, names["outputs"], names["inputs"], **found, findings=left_out)


def _array(path: Path, key: str, value: Any, kind: Any) -> Any:
    array = np.asarray(value)
    if array.dtype.kind not in ("iufc" if kind is np.complex128 else "iuf") or array.size == 0:
        raise RecordError(f"{path}: {key} holds {array.dtype} of shape {array.shape}; give numbers")
    return array.astype(kind)


def _from_universal(path: Path) -> RawResponse:
    pyuff = extra("pyuff", path)
    with reading(path, RecordError, "a readable Universal File", "save it again"):
        file = pyuff.UFF(str(path))
        kinds = np.atleast_1d(file.get_set_types()).astype(int)
        sets = [file.read_sets(int(k)) for k in np.flatnonzero(kinds == 58)]
    places: dict[tuple[float, str, str], dict[str, float]] = {}
    others = int(np.sum(kinds != 58))
    for own in sets:
        if own["func_type"] not in (FRF, COHERENCE):
            others += 1
            continue
        output, inlet = (_channel(own, side) for side in ("rsp", "ref"))
        for frequency, value in zip(np.asarray(own["x"]).tolist(), np.asarray(own["data"]).tolist(), strict=True):
            at = places.setdefault((float(frequency), output, inlet), {})
            new = {"coherence": float(np.real(value))}
            if own["func_type"] == FRF:
                new = {"re": float(np.real(value)), "im": float(np.imag(value))}
            if new.keys() & at.keys():
                raise RecordError(
                    f"{path}: {output} / {inlet} is there twice at {frequency:g} Hz; keep one of the sets"
                )
            at.update(new)
    places = {key: values for key, values in places.items() if "re" in values and key[0] > 0.0}
    if not places:
        raise RecordError(f"{path}: no set 58 with a frequency response; export functions of type {FRF}")
    raw = _tabled(places)
    raw.findings = [SETS_NOT_READ(count=others)] if others else []
    return raw


def _channel(own: dict[str, Any], side: str) -> str:
    """Name of the entity that responds or is excited, or else its node and direction, such as ``12+X``."""
    name = str(own.get(f"{side}_ent_name", "")).strip()
    if name and name.upper() != "NONE":
        return name
    return f"{int(own[f'{side}_node'])}{DIRECTIONS.get(int(own[f'{side}_dir']), '')}"
