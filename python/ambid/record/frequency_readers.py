"""The file formats of frequency responses, CSV, MATLAB and Universal File Format 58, read into named arrays."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.findings import Kind
from ambid.reading import reading, variables_of, watched
from ambid.record.channel_map import ChannelMap
from ambid.record.content import COLUMNS_NOT_USED, VARIABLES_NOT_USED, unused
from ambid.record.csv_table import UNITS_NOT_READ, Cells, header_of, read_cells
from ambid.record.quantities import (
    FORMS,
    OURS,
    PLAIN,
    SIGNALS,
    SPEED,
    UNITS_ASSUMED,
    VALUES,
    Quantity,
    holds_quantities,
    hz_of,
    quantity_of,
    values_of,
)
from ambid.record.raw import OF_AXES
from ambid.record.raw_response import COVARIANCE, FURTHER, RawResponse, tabled
from ambid.record.readers import flatten_cells, opened, require_content
from ambid.record.universal import UNIVERSAL, read_universal
from ambid.rig import Rig

PAIR_ASSUMED = Kind(
    "pair_assumed",
    "warning",
    "no column names the measured pair: taken as {output} by {input}",
    "name it with --map output={output} --map input={input}",
)
UNNAMED = {"output": "y", "input": "i_e"}
"""Signals of a pair that nothing names."""
PAIR = re.compile(r"(?P<output>\w+\.\w+?)(?:\s*/\s*(?P<input>\w+\.\w+?))?[\s:,]+(?P<quantity>.+)")
"""A column of one pair among several."""
FREQUENCIES = ("frequency_hz", "frequency_rad_s", "frequency_rpm")


def holds_response(path: Path, mapping: ChannelMap | None = None) -> bool:
    """Whether a file holds frequency responses rather than signals over time."""
    suffix = path.suffix.lower()
    if suffix in UNIVERSAL:
        return True
    if not path.is_file():
        return False
    if suffix == ".csv":
        return _is_table(path, mapping)
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
            raw = _from_table(path, mapping, () if rig is None else rig.axes)
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
            found["response"], *_ = values_of(path, own, values, f, names["outputs"])
        f, _ = hz_of(path, frequency, OURS[frequency], f)
    return RawResponse(f, names["outputs"], names["inputs"], **found, findings=left_out)


def _array(path: Path, key: str, value: Any, kind: Any) -> Any:
    array = np.asarray(value)
    if array.dtype.kind not in ("iufc" if kind is np.complex128 else "iuf") or array.size == 0:
        raise RecordError(f"{path}: {key} holds {array.dtype} of shape {array.shape}; give numbers")
    return array.astype(kind)


def _is_table(path: Path, mapping: ChannelMap | None) -> bool:
    """Whether a table of text holds frequency responses rather than signals over time, by the names of its columns."""
    names, mapped = header_of(path), {} if mapping is None else mapping.response_columns
    frequency = next((column for name, (column, _) in mapped.items() if name.startswith("frequency")), None)
    if frequency is not None and (frequency in names or mapping is not None and not mapping.channels):
        return True
    pairs = {name: own[2] for name in names if (own := _of_pair(name)) is not None}
    if "t" in names or not pairs and any(name.startswith(OF_AXES) for name in names):
        return False
    needs_frequency = mapping is not None and bool(mapping.channels)  # or else they are of signals over time
    return holds_quantities([pairs.get(name, name) for name in names], needs_frequency=needs_frequency)


def _from_table(path: Path, mapping: ChannelMap | None, axes: Sequence[str]) -> RawResponse:
    """Read a table, a row a frequency and pair, or a row a frequency with columns for several pairs.

    The latter are named by their pair and quantity, such as ``y.A_zeta / i_e.A_zeta magnitude_db``.

    Parameters
    ----------
    path : Path
    mapping : ChannelMap, optional
        Names of its columns, if they are none that `quantity_of` knows.
    axes : sequence of str
        Of the rig: the one axis of a table that names no pair.

    Raises
    ------
    RecordError
        If columns are missing or named twice, a cell is no number, or a pair has two values at one frequency.
    """
    table = _row_by_pair(path, read_cells(path), axes)
    header, rows = table.names, table.rows
    columns, factors, constants = _columns(path, table, mapping)
    missing = [name for name in UNNAMED if name not in columns and name not in constants]
    if missing and len(axes) == 1:
        labels = {own.label for name, (_, own) in columns.items() if name in VALUES}
        signals = labels.pop().replace(" ", "").split("/") if len(labels) == 1 else []
        of_label = dict(zip(UNNAMED, (own.partition(".")[0] for own in signals), strict=False))
        named = {name: of_label[name] for name in missing if of_label.get(name) in SIGNALS}
        constants |= {name: f"{named.get(name, UNNAMED[name])}.{axes[0]}" for name in missing}
        missing = [name for name in missing if name not in named]
    form = next((form for form in FORMS if set(form) <= columns.keys()), None)
    absent = [] if "frequency" in columns else [" or ".join(FREQUENCIES)]
    absent += [name for name in missing if name not in constants]
    if form is None:
        begun = next((form for form in FORMS if set(form) & columns.keys()), FORMS[0])
        absent += [_example(name) for name in begun if name not in columns]
    if form is None or absent:
        raise RecordError(
            f"{path}: no column {', '.join(absent)}; the columns are {', '.join(header)}; rename them, or map them, "
            "such as frequency_hz=COLUMN, magnitude_db=COLUMN, phase_deg=COLUMN, output=y.A_zeta, input=i_e.A_zeta"
        )
    own = {name: columns[name] for name in form}
    numeric = {"frequency": columns["frequency"], **own} | {name: columns[name] for name in FURTHER if name in columns}
    at = {name: header.index(column) for name, (column, _) in columns.items()}
    takes_units = any(
        table.units[at[name]] and own.unit == _plain(table.units[at[name]])
        for name, own in ((n, q) for n, (_, q) in columns.items())
    )
    covariances = {name: k for k, name in enumerate(header) if name.startswith(COVARIANCE)}
    numbers = {name: _numbers(path, table, at[name]) * factors.get(name, 1.0) for name in numeric}
    numbers |= {name: _numbers(path, table, k) for name, k in covariances.items()}
    wrong = np.flatnonzero(~np.isfinite(numbers["frequency"]))
    if len(wrong):
        column, value = columns["frequency"][0], numbers["frequency"][wrong[0]]
        raise RecordError(f"{path}: {column} is {value} in row {wrong[0] + 1}; give a frequency above 0")
    hz, unstated = hz_of(path, *columns["frequency"], numbers["frequency"])
    outputs, inputs = ([constants.get(name) or row[at[name]] for row in rows] for name in UNNAMED)
    values, more, integrated = values_of(path, own, numbers, hz, outputs)
    further = {name: numbers[name] for name in (*FURTHER, *covariances) if name in numbers}
    raw = tabled(_places(path, list(zip(hz.tolist(), outputs, inputs, strict=True)), values, further))
    known = {f"{part} {output} / {inlet}" for part in COVARIANCE for output in raw.outputs for inlet in raw.inputs}
    used = {columns[name][0] for name in (*numeric, *UNNAMED) if name in columns} | known
    raw.findings = [
        *(own for own in table.findings if own.kind != UNITS_NOT_READ or not takes_units),
        *([UNITS_ASSUMED(units=unstated | more)] if unstated or more else []),
        *integrated,
        *([PAIR_ASSUMED(output=outputs[0], input=inputs[0])] if missing else []),
        *unused(COLUMNS_NOT_USED, (name for name in header if name not in used)),
    ]
    return raw


def _of_pair(header: str) -> tuple[str, str, str] | None:
    """Output, input and quantity of a column of one pair among several; the input is empty where none is named."""
    found = PAIR.fullmatch(header.strip())
    if found is None or quantity_of(found["quantity"]) is None:
        return None
    return found["output"], found["input"] or "", found["quantity"]


def _row_by_pair(path: Path, table: Cells, axes: Sequence[str]) -> Cells:
    """A table with columns for several pairs as one with a row a frequency and pair; another as it is.

    Raises
    ------
    RecordError
        If pairs have other quantities than the first has, or no input where the rig has several axes.
    """
    own = {k: found for k, name in enumerate(table.names) if (found := _of_pair(name)) is not None}
    if not own:
        return table
    columns: dict[tuple[str, str], dict[str, int]] = {}
    for k, (output, inlet, quantity) in own.items():
        columns.setdefault((output, inlet), {})[quantity] = k
    (first, quantities), *others = columns.items()
    for pair, named in others:
        if set(named) != set(quantities):
            raise RecordError(
                f"{path}: {' / '.join(pair)} has {', '.join(named)}, and {' / '.join(first)} has "
                f"{', '.join(quantities)}; give the same of every pair"
            )
    for output, inlet in columns:
        if not inlet and len(axes) != 1:
            raise RecordError(f"{path}: {output}: no input is named; name the pair, such as {output} / i_e.A_zeta")
    shared = [k for k in range(len(table.names)) if k not in own]
    names = [*(table.names[k] for k in shared), *quantities, *UNNAMED]
    units = [*(table.units[k] for k in shared), *(table.units[k] for k in quantities.values()), "", ""]
    rows = [
        [*(row[k] for k in shared), *(row[named[q]] for q in quantities), output, inlet or f"i_e.{axes[0]}"]
        for row in table.rows
        for (output, inlet), named in columns.items()
    ]
    return replace(table, names=names, units=units, rows=rows)


def _places(
    path: Path, keys: Sequence[tuple[float, str, str]], values: ComplexArray, further: Mapping[str, FloatArray]
) -> dict[tuple[float, str, str], dict[str, float]]:
    """Values of every row by frequency, output and input; refuses two of one place."""
    places: dict[tuple[float, str, str], dict[str, float]] = {}
    for k, key in enumerate(keys):
        if key in places:
            what = f"{key[1]} / {key[2]} at {key[0]:g} Hz"
            raise RecordError(f"{path}: row {k + 1}: {what} is there already; keep one of the two")
        own = {name: float(column[k]) for name, column in further.items()}
        places[key] = {"re": values[k].real, "im": values[k].imag, **own}
    return places


def _columns(
    path: Path, table: Cells, mapping: ChannelMap | None
) -> tuple[dict[str, tuple[str, Quantity]], dict[str, float], dict[str, str]]:
    """Column and quantity by the name of the quantity, factors, and channels of the only pair."""
    columns: dict[str, tuple[str, Quantity]] = {}
    factors: dict[str, float] = {}
    constants: dict[str, str] = {}
    for name, (column, factor) in ({} if mapping is None else mapping.response_columns).items():
        quantity = OURS[name]
        if column in table.names:
            columns[quantity.name] = column, quantity
        elif column.isdecimal() and 1 <= int(column) <= len(table.names):
            columns[quantity.name] = table.names[int(column) - 1], quantity
        elif name in UNNAMED:
            constants[name] = column
        else:
            present = ", ".join(table.names)
            raise RecordError(f"{path}: map {name}={column}: there is no such column; the columns are {present}")
        factors[quantity.name] = factor
    found: dict[str, list[tuple[str, Quantity]]] = {}
    for header, unit in zip(table.names, table.units, strict=True):
        own = quantity_of(header) or quantity_of(f"{header} [{unit}]")
        if own is not None and own.name not in columns and own.name not in constants:
            found.setdefault(own.name, []).append((header, replace(own, unit=_unit(own, unit))))
    speeds = found.pop(SPEED, [])
    if speeds and "frequency" not in (*columns, *found):
        found["frequency"] = speeds
    for name, several in found.items():
        chosen = [one for one in several if one[1].is_ours][:1] or several
        if len(chosen) > 1:
            headers = " and ".join(header for header, _ in chosen)
            raise RecordError(
                f"{path}: {headers} are both a {name}; map one of them, such as {_example(name)}={chosen[0][0]}"
            )
        columns[name] = chosen[0]
    return columns, factors, constants


def _unit(quantity: Quantity, below: str) -> str:
    """That of a column: from its name, or else from the line of units below."""
    return _plain(below) or quantity.unit if quantity.unit.lower() in ("", *PLAIN) else quantity.unit


def _plain(unit: str) -> str:
    return unit.strip("[]()- ")


def _example(name: str) -> str:
    """A name of ours for a quantity."""
    return {"frequency": "frequency_hz", "magnitude": "magnitude_db", "phase": "phase_deg"}.get(name, name)


def _numbers(path: Path, table: Cells, column: int) -> FloatArray:
    """Values of a column; NaN where a cell is empty."""
    values = np.full(len(table.rows), np.nan)
    for k, row in enumerate(table.rows):
        cell = row[column]
        try:
            values[k] = float(cell or "nan")
        except ValueError:
            raise RecordError(
                f"{path}: {table.names[column]}, row {k + 1}: {cell!r} is not a number; correct the cell"
            ) from None
    return values
