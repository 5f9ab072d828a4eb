"""What somebody should look at: a stable code, where, and values; its text is made from them here, and nowhere else."""

from __future__ import annotations

import string
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from math import isfinite, pi
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
"""Worst first."""
KINDS: dict[str, Kind] = {}
"""Every kind of finding by its code, as the rooms that make them have declared it."""
SCALES = {
    "nm": (1e9, "nm"),
    "um": (1e6, "um"),
    "mm": (1e3, "mm"),
    "degrees": (180.0 / pi, "degrees"),
    "us": (1e6, "us"),
    "ms": (1e3, "ms"),
    "mA": (1e3, "mA"),
    "%": (100.0, "%"),
    "ppm": (1e6, "ppm"),
}
"""Factor and unit of a number that is printed in another unit than that of its value."""
AGAINST = "against"
"""In place of a unit, of a number with so many digits that it differs from its limit: ``{misfit:{limit}|against}``."""


@dataclass(frozen=True)
class Where:
    """What a finding is about, as far as it is known.

    Attributes
    ----------
    file : str
        Path, as it was given.
    record : str
        Name of a record.
    channel : str
        Such as ``y.A_zeta``, or the signal ``y`` where all axes are meant.
    axis : str
        Such as ``A_zeta``.
    key : str
        Of the rig file, such as ``bearing.A.position``.
    """

    file: str = ""
    record: str = ""
    channel: str = ""
    axis: str = ""
    key: str = ""

    def __str__(self) -> str:
        """What stands before the text of a finding, such as ``run_1, y.A_zeta``."""
        return ", ".join(part for part in (self.record or self.file, self.key, self.channel or self.axis) if part)


NOWHERE = Where()


@dataclass(frozen=True)
class Kind:
    """One kind of finding, declared in the room that makes it.

    Attributes
    ----------
    code : str
        A stable word, unique among all kinds.
    severity : {"error", "warning", "note"}
        An error makes every result worthless as things stand, a warning makes some doubtful, a note is good to know.
    message : str
        Template of the value found and what was expected. Fields are values by name, with a format of Python, and with
        a unit of `SCALES` where wanted: ``{delay_s:.3g|us}``, or `AGAINST` another. What stands in square brackets is
        left out where one of its fields has no value; lists are written with commas, and what has names with these
        before it.
    remedy : str
        Template of what to do; empty where nothing is to be done.
    """

    code: str
    severity: Severity
    message: str
    remedy: str = ""

    def __post_init__(self) -> None:
        if KINDS.setdefault(self.code, self) != self:
            raise ValueError(f"two kinds of finding have the code {self.code}")

    def __call__(self, where: Where = NOWHERE, /, *, severity: Severity | None = None, **values: Any) -> Finding:
        """Return a finding of this kind, of another severity than usual where that hangs on the values."""
        return Finding(self, where, MappingProxyType(values), severity or self.severity)


@dataclass(frozen=True)
class Finding:
    """One thing that somebody should look at.

    Attributes
    ----------
    kind : Kind
    where : Where
    values : mapping of str to object
        SI units, which stand in the name where they can be misread: ``delay_s``, ``frequency_hz``.
    severity : {"error", "warning", "note"}
    """

    kind: Kind
    where: Where
    values: Mapping[str, Any]
    severity: Severity

    @property
    def code(self) -> str:
        """Stable word for scripts."""
        return self.kind.code

    @property
    def message(self) -> str:
        """The value found, and what was expected."""
        return _rendered(self.kind.message, self.values)

    @property
    def remedy(self) -> str:
        """What to do about it; empty where nothing is to be done."""
        return _rendered(self.kind.remedy, self.values)

    def at(self, **where: str) -> Finding:
        """The same finding about a place that is better known, such as ``finding.at(record="run_1")``."""
        return replace(self, where=replace(self.where, **where))

    def line(self, *, advises: bool = True) -> str:
        """In one line, with what to do about it or without."""
        text = f"{self.where}: {self.message}" if str(self.where) else self.message
        return f"{text}; {self.remedy}" if advises and self.remedy else text

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "code": self.code,
            "severity": self.severity,
            "where": {name: value or None for name, value in asdict(self.where).items()},
            "values": {name: _plain(value) for name, value in self.values.items()},
            "message": self.message,
            "remedy": self.remedy,
        }

    def __reduce__(self) -> tuple[Any, ...]:
        return _finding, (self.kind, self.where, dict(self.values), self.severity)

    def __hash__(self) -> int:
        return hash((self.kind.code, self.where, self.message))


REMARK = Kind("remark", "note", "{text}")
"""Words of a person or of code of theirs, for which there is no kind."""


class WithFindings:
    """A result that has findings: a field of this name, or a property."""

    if TYPE_CHECKING:

        @property
        def findings(self) -> tuple[Finding, ...]:
            """In the order in which they are shown."""

    @property
    def notes(self) -> tuple[str, ...]:
        """The findings in words, a line each."""
        return tuple(finding.line() for finding in self.findings)

    def finding_lines(self) -> list[str]:
        """The same with their severity, as a result prints them."""
        return [f"{finding.severity}: {finding.line()}" for finding in self.findings]

    def findings_as_dict(self) -> dict[str, list[Any]]:
        """The findings, and their lines as ``notes``, as the JSON of every result has them."""
        return {"findings": [finding.as_dict() for finding in self.findings], "notes": list(self.notes)}


def has(findings: Iterable[Finding], *kinds: Kind) -> bool:
    """Whether one of these kinds is among the findings."""
    codes = {kind.code for kind in kinds}
    return any(finding.code in codes for finding in findings)


def worst_first(findings: Iterable[Finding]) -> list[Finding]:
    """Errors, then warnings, then notes, each in the order in which they were found."""
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def _finding(kind: Kind, where: Where, values: dict[str, Any], severity: Severity) -> Finding:
    return kind(where, severity=severity, **values)


class _Words(string.Formatter):
    """Values as a reader wants them: lists with commas, numbers in the unit behind ``|``."""

    def format_field(self, value: Any, format_spec: str) -> str:
        digits, _, unit = format_spec.partition("|")
        if unit == AGAINST:
            return _against(value, float(digits))
        if isinstance(value, list | tuple):
            return ", ".join(self.format_field(entry, format_spec) for entry in value)
        if isinstance(value, Mapping):
            return ", ".join(f"{name} {self._inner(entry, format_spec)}" for name, entry in value.items())
        if not unit:
            return format(value, digits)
        factor, name = SCALES[unit]
        return f"{format(factor * value, digits)} {name}"

    def _inner(self, value: Any, format_spec: str) -> str:
        text = str(self.format_field(value, format_spec))
        return f"({text})" if isinstance(value, Mapping) else text


def _against(value: float, limit: float) -> str:
    """Two decimals, or as many as it takes to see which of two numbers is the larger."""
    digits = next((digits for digits in range(2, 7) if f"{value:.{digits}f}" != f"{limit:.{digits}f}"), 7)
    return f"{value:.{digits}f}"


def _rendered(template: str, values: Mapping[str, Any]) -> str:
    words, text = _Words(), ""
    for is_optional, part in _parts(template):
        fields = [name for _, name, _, _ in words.parse(part) if name]
        if is_optional and not fields:
            text += f"[{part}]"  # such as [controller], the table of a rig file
        elif not is_optional or all(values.get(name) is not None for name in fields):
            text += words.vformat(part, (), values)
    return text


def _parts(template: str) -> Iterable[tuple[bool, str]]:
    """The template cut at its square brackets: whether a part stands in them, and the part."""
    for k, piece in enumerate(template.split("[")):
        if k == 0:
            yield False, piece
            continue
        inside, _, behind = piece.partition("]")
        yield True, inside
        yield False, behind


def _plain(value: Any) -> Any:
    """Strict JSON: null for a number that is not finite."""
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, Mapping):
        return {name: _plain(entry) for name, entry in value.items()}
    if hasattr(value, "item"):  # a scalar of NumPy
        value = value.item()
    if isinstance(value, float):
        return value if isfinite(value) else None
    return value
