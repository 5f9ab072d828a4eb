"""Frequency responses of Universal Files: sets 58, in the units of set 164 or of their labels."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.reading import reading
from ambid.record.channel_map import ChannelMap
from ambid.record.quantities import (
    INTEGRATIONS,
    UNITS_CONVERTED,
    Unit,
    frequency_unit,
    integrated,
    ratio_of,
    unit_of,
)
from ambid.record.raw_response import RawResponse, tabled
from ambid.record.readers import extra
from ambid.rig import Rig

UNIVERSAL = (".uff", ".unv")
RESPONSE, UNITS = 58, 164
"""Numbers of data sets."""
FRF, COHERENCE = 4, 6
"""Types of functions of the sets 58."""
FREQUENCY, SPEED = 18, 19
"""Specific data types of an abscissa."""
UNSTATED = (0, 1)
"""Specific data types, unknown and general, which say nothing of what is measured."""
MOTIONS = {8: "displacement", 11: "velocity", 12: "acceleration"}
SI = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
CURRENTS = {"i_e": ("current", "voltage"), "i_c": ("current",), "i_ref": ("current", "voltage")}
"""What signals without a motion may be measured in; the command of a voltage-driven coil is one of voltage."""
DIRECTIONS = {0: "", 1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}
SETS_NOT_READ = Kind("sets_not_read", "note", "{count} sets are no frequency responses, and were not read")
UNITS_CONTRADICT = Kind(
    "units_contradict",
    "warning",
    "{channels}: the label says {label}, the units of data set 164 make another factor of it ({factor:g}, {of_164:g}); "
    "the label is taken",
    "see which of the two is right, and map the channel with its factor",
)
MAP_FACTOR = Kind(
    "map_replaces_units", "note", "{channels}: the factor of the map is taken in place of the file's unit, {label}"
)


@dataclass
class _File:
    """What was read so far, and what was noticed."""

    path: Path
    mapping: ChannelMap | None
    rig: Rig | None
    findings: list[Finding] = field(default_factory=list)

    def note(self, finding: Finding) -> None:
        """Keep a finding, once."""
        if finding not in self.findings:
            self.findings.append(finding)

    def channel(self, name: str) -> tuple[str, bool]:
        """What a channel is read as, and whether the map has a factor for it."""
        mapped = None if self.mapping is None else self.mapping.channel_of(name)
        return (name, False) if mapped is None or self.mapping is None else (mapped[0], self.mapping.has_factor(name))


def read_universal(path: Path, mapping: ChannelMap | None = None, rig: Rig | None = None) -> RawResponse:
    """Read the sets 58 that hold frequency responses, and those with their coherences.

    The ordinate of y and r is made a displacement in m: by the unit of its axis label, or else by its specific data
    type and the length of the data set 164 before it. Velocities are divided by 2 pi j f, accelerations by its square.
    A factor of the map replaces the unit that the file states.

    Raises
    ------
    RecordError
        If the file is damaged, holds no response or a pair twice, or a unit or specific data type is unknown.
    InputError
        If pyuff is not installed.
    """
    pyuff = extra("pyuff", path)
    with reading(path, RecordError, "a readable Universal File", "save it again"):
        file = pyuff.UFF(str(path))
        kinds = np.atleast_1d(file.get_set_types()).astype(int)
        sets = {int(k) + 1: file.read_sets(int(k)) for k in np.flatnonzero(np.isin(kinds, (RESPONSE, UNITS)))}
    state = _File(path, mapping, rig)
    places: dict[tuple[float, str, str], dict[str, float]] = {}
    others = len(kinds) - len(sets)
    length = next((_length(path, k, own) for k, own in sets.items() if int(own["type"]) == UNITS), None)
    for number, own in sets.items():
        if int(own["type"]) == UNITS:
            length = _length(path, number, own)
            continue
        if own["func_type"] not in (FRF, COHERENCE):
            others += 1
            continue
        output, inlet = (_channel(own, side) for side in ("rsp", "ref"))
        where = f"{path}: data set {number} ({output} / {inlet})"
        hz = np.asarray(own["x"], dtype=np.float64) * _hz(where, own)
        values = np.asarray(own["data"], dtype=np.complex128)
        if own["func_type"] == FRF:
            values = _in_si(state, where, own, (output, inlet), hz, values, length)
        for frequency, value in zip(hz.tolist(), values.tolist(), strict=True):
            at = places.setdefault((float(frequency), output, inlet), {})
            new = {"coherence": value.real}
            if own["func_type"] == FRF:
                new = {"re": value.real, "im": value.imag}
            if new.keys() & at.keys():
                raise RecordError(
                    f"{path}: {output} / {inlet} is there twice at {frequency:g} Hz; keep one of the sets"
                )
            at.update(new)
    places = {key: values for key, values in places.items() if "re" in values}
    if not places:
        raise RecordError(f"{path}: no set 58 with a frequency response; export functions of type {FRF}")
    raw = tabled(places)
    raw.findings = [*([SETS_NOT_READ(count=others)] if others else []), *state.findings]
    return raw


def _length(path: Path, number: int, own: Mapping[str, Any]) -> float:
    """Factor that makes m of lengths by a set 164, which states what to divide by."""
    value = float(own["length"])
    if not (np.isfinite(value) and value > 0.0):
        raise RecordError(
            f"{path}: data set {number} (164, units): the factor of length is {value:g}; expected one above 0, such as "
            "1 for m and 1000 for mm"
        )
    return 1.0 / value


def _hz(where: str, own: Mapping[str, Any]) -> float:
    """Factor that makes Hz of the abscissa."""
    kind, label = int(own["abscissa_spec_data_type"]), _label(own, "abscissa")
    if kind not in (*UNSTATED, FREQUENCY, SPEED):
        raise RecordError(
            f"{where}: the abscissa has the specific data type {kind}; expected {FREQUENCY}, frequency, or {SPEED}, rpm"
        )
    factor = frequency_unit(label or ("rpm" if kind == SPEED else "Hz"))
    if factor is None:
        raise RecordError(f"{where}: the unit of the abscissa is {label!r}; expected Hz, rad/s or rpm")
    return factor


def _in_si(
    state: _File,
    where: str,
    own: Mapping[str, Any],
    names: tuple[str, str],
    hz: FloatArray,
    values: ComplexArray,
    length: float | None,
) -> ComplexArray:
    """Values of a response in m or A by A or m, the factors of the map left to it."""
    label = _label(own, "ordinate")
    found = ratio_of(label) if label else None
    if label and found is None:
        raise RecordError(
            f"{where}: the unit of the ordinate is {label!r}; expected that of a length, velocity or acceleration, "
            "such as m, mm, um, mil, mm/s, m/s^2, g, or of current, A or mA"
        )
    upper, lower = found or (None, None)
    below = _label(own, "orddenom")
    if below and lower is None and (lower := unit_of(below)) is None:
        raise RecordError(f"{where}: the unit of the ordinate's denominator is {below!r}; expected A, mA, V or m")
    above_type, below_type = (int(own[f"{side}_spec_data_type"]) for side in ("ordinate", "orddenom"))
    factor, order = _side(state, where, names[0], upper, label, above_type, length)
    by, its = _side(state, where, names[1], lower, below or label, below_type, length)
    return np.asarray(values * (factor / by) * integrated(hz, order - its))


def _side(
    state: _File, where: str, name: str, unit: Unit | None, label: str, kind: int, length: float | None
) -> tuple[float, int]:
    """Factor to SI of a response or an excitation, and how often it is to be integrated to a displacement."""
    channel, is_mapped = state.channel(name)
    signal = channel.partition(".")[0]
    if signal in CURRENTS:
        wanted = CURRENTS[signal]
        if state.rig is not None and signal != "i_c":
            wanted = ("voltage",) if state.rig.amplifier.command_unit == "V" else ("current",)
        if unit is not None and unit.kind not in wanted:
            units = "V or mV" if wanted == ("voltage",) else "A or mA"
            raise RecordError(
                f"{where}: {name} is in {label}, a {unit.kind}; {channel} is a {wanted[0]}: expected {units}"
            )
        factor = 1.0 if unit is None else unit.factor
        if unit is None and kind in MOTIONS and kind != 8:
            raise RecordError(
                f"{where}: {name} has the specific data type {kind}, {MOTIONS[kind]}; {channel} is a current: expected "
                "1, general, and a label A or mA"
            )
        return _taken(state, name, factor, is_mapped, label, "A"), 0
    if signal not in ("y", "r"):
        return 1.0, 0  # not used, or refused by its name
    if unit is not None and unit.kind not in INTEGRATIONS:
        raise RecordError(
            f"{where}: {name} is in {label}, a {unit.kind}; {channel} is a displacement: expected m or mm"
        )
    motion = MOTIONS.get(kind)
    if motion is None and kind in UNSTATED:
        motion = unit.kind if unit is not None else "displacement" if is_mapped else None
    if motion is None:
        raise RecordError(
            f"{where}: {name} has the specific data type {kind}"
            + (" and no label with its unit" if kind in UNSTATED else "")
            + "; expected 8, displacement, 11, velocity, or 12, acceleration; export it so, or with a label such as m, "
            "m/s or g, or map it with its factor"
        )
    if unit is not None and unit.kind != motion:
        raise RecordError(
            f"{where}: {name} has the specific data type {kind}, {motion}, and its label says {label}, a {unit.kind}; "
            "correct the one that is wrong"
        )
    of_file = 1.0 if length is None else length
    factor = of_file if unit is None else unit.factor
    if unit is not None and length is not None and not np.isclose(factor, of_file, rtol=1e-3) and not is_mapped:
        state.note(UNITS_CONTRADICT(channels=[name], label=label, factor=factor, of_164=of_file))
    said = f"{motion} in {label or ('' if of_file == 1.0 else f'{of_file:g} ') + SI[motion]}"
    taken = _taken(state, name, factor, is_mapped, said, "m", is_changed=motion != "displacement")
    return taken, INTEGRATIONS[motion]


def _taken(
    state: _File, name: str, factor: float, is_mapped: bool, said: str, unit: str, *, is_changed: bool = False
) -> float:
    """The factor of the file, or 1 where the map has one; noted where that makes a difference."""
    if is_mapped:
        if factor != 1.0:
            state.note(MAP_FACTOR(channels=[name], label=said))
        return 1.0
    if factor != 1.0 or is_changed:
        state.note(UNITS_CONVERTED(channels=[name], found=said, unit=unit))
    return factor


def _label(own: Mapping[str, Any], side: str) -> str:
    """Unit of an axis; empty where it is not used."""
    text = str(own.get(f"{side}_axis_units_lab", "")).strip()
    return "" if text.upper() in ("NONE", "-", "1") else text


def _channel(own: Mapping[str, Any], side: str) -> str:
    """Name of the entity that responds or is excited, or else its node and direction, such as ``12+X``."""
    name = str(own.get(f"{side}_ent_name", "")).strip()
    if name and name.upper() != "NONE":
        return name
    return f"{int(own[f'{side}_node'])}{DIRECTIONS.get(int(own[f'{side}_dir']), '')}"
