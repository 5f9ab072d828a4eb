"""Records that were not made for ambid: which of a file's columns are which signals, and in which units."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambid.channels import SIGNALS, Channel
from ambid.errors import InputError, RecordError
from ambid.findings import Finding, Kind
from ambid.record.content import (
    COLUMNS_NOT_USED,
    TRANSPOSED,
    Content,
    NotNumbers,
    Stored,
    aligned,
    require_unique,
    unused,
)
from ambid.record.quantities import OURS
from ambid.record.raw import RawRecord, lacks_motion, numbers, require_agreement

EXAMPLE = "y.A_zeta=ch3:1e-6"
RESPONSE_COLUMNS = OURS.keys() - {"spread"}
"""Of a table of frequency responses: a map may say which columns they are."""
COLUMNS_MAPPED = Kind("columns_mapped", "note", "column mapping applied ({count} columns)")


@dataclass(frozen=True)
class _Source:
    """A column by name or number, and the factor that makes SI units of its values."""

    column: str
    factor: float
    is_stated: bool = False
    """Whether the factor is."""


class ChannelMap:
    """Which columns of a file are which channels of a record.

    Parameters
    ----------
    channels : mapping of str to str
        Column of each channel, such as ``{"t": "time:1e-3", "y.A_zeta": "ch3:1e-6"}``.
        A channel is ``t`` [s], ``fs`` [Hz], or ``i_e``, ``r``, ``y``, ``i_c``, ``i_ref`` with an axis [A, m], or one of
        `SIGNALS` beyond them with an axis or sensor.
        A column is meant by its name, or, where none has that name, by its number, counted from 1; column k of a
        matrix ``data`` is ``data[k]``. A number behind the last colon is the factor that makes SI units of it, 1 if
        there is none; a name that itself ends like that needs ``:1`` behind it.
        Of a table of frequency responses, columns such as ``frequency_hz``, ``magnitude_db`` or ``phase_deg`` may be
        mapped too; ``output`` and ``input`` are columns, or, of a table of one response, channels such as ``y.A_zeta``.

    Raises
    ------
    InputError
        If a channel is unknown, a factor is zero or not finite, or there is no y.
    """

    def __init__(self, channels: Mapping[str, str]) -> None:
        sources = {channel: _source(channel, text) for channel, text in channels.items()}
        self._sources = {channel: own for channel, own in sources.items() if channel not in RESPONSE_COLUMNS}
        self._columns = {channel: own for channel, own in sources.items() if channel in RESPONSE_COLUMNS}
        if not self._columns and lacks_motion(channels):
            raise InputError(f"map: no y.<axis> in {', '.join(channels) or 'it'}; name one per axis, such as {EXAMPLE}")

    @classmethod
    def parse(cls, options: Iterable[str]) -> ChannelMap:
        """Read options such as ``y.A_zeta=ch3:1e-6``.

        Raises
        ------
        InputError
            If one is written otherwise, or a channel is named twice; and as for the class.
        """
        channels: dict[str, str] = {}
        for option in options:
            channel, _, column = option.partition("=")
            if not channel or not column:
                raise InputError(f"map {option}: expected CHANNEL=COLUMN or CHANNEL=COLUMN:FACTOR, such as {EXAMPLE}")
            if channel in channels:
                raise InputError(f"map {option}: {channel} is mapped to {channels[channel]} already; keep one")
            channels[channel] = column
        return cls(channels)

    @classmethod
    def load(cls, path: str | Path) -> ChannelMap:
        """Read a text file of options, as `options_of` does.

        Raises
        ------
        InputError
            If the file cannot be read, and as for `parse`.
        """
        return cls.parse(cls.options_of(path))

    @staticmethod
    def options_of(path: str | Path) -> list[str]:
        """Options such as ``y.A_zeta=ch3:1e-6`` of a text file: words as a shell reads them, on one line or several.

        ``--map`` may stand before each of them, and lines that begin with ``#`` are comments.

        Raises
        ------
        InputError
            If the file cannot be read, has a quote without an end, or a word that is no such option.
        """
        try:
            lines = Path(path).read_text(encoding="utf-8-sig").replace("\\\n", " ").splitlines()
            words = [word for line in lines if not line.lstrip().startswith("#") for word in shlex.split(line)]
        except (OSError, ValueError) as error:  # a quote without an end, or what is no text
            why = error.strerror if isinstance(error, OSError) else str(error)
            raise InputError(f"map {path}: cannot be read ({why}); expected a text file of {EXAMPLE} ...") from None
        options = [word.removeprefix("--map=") for word in words if word != "--map"]
        for option in options:
            if "=" not in option or option.startswith("--"):
                raise InputError(
                    f"map {path}: {option!r}: expected CHANNEL=COLUMN or CHANNEL=COLUMN:FACTOR, such as {EXAMPLE}; "
                    "give other arguments to the command itself"
                )
        return options

    @property
    def channels(self) -> list[str]:
        """The channels that are mapped."""
        return list(self._sources)

    @property
    def response_columns(self) -> dict[str, tuple[str, float]]:
        """Column and factor of what is mapped of a table of frequency responses, such as ``frequency_hz``."""
        return {name: (source.column, source.factor) for name, source in self._columns.items()}

    def has_factor(self, column: str) -> bool:
        """Whether a factor stands beside a column that is a channel."""
        return any(source.is_stated for source in self._sources.values() if source.column == column)

    def channel_of(self, column: str) -> tuple[str, float] | None:
        """Channel that a column is read as, and the factor that makes SI units of it; None for one that is not used."""
        own = ((c, source.factor) for c, source in self._sources.items() if source.column == column)
        return next(own, None)

    def raw_record(self, path: Path, content: Content, sample_rate: float | None = None) -> RawRecord:
        """Make signals of the mapped columns.

        Parameters
        ----------
        path : Path
            For the messages.
        content : Content
        sample_rate : float, optional
            Of a file that states none [Hz].

        Raises
        ------
        RecordError
            If a column is missing or holds no numbers, the lengths differ, or nothing gives the sample rate.
        """
        if not self._sources:
            first = next(iter(self._columns))
            raise RecordError(
                f"{path}: map {first}: {first} is a column of frequency responses, and this file holds signals over "
                "time; leave it out of the map"
            )
        columns = _columns(content)
        names = {channel: self._name(path, channel, columns, content) for channel in self._sources}
        values = {
            channel: columns[names[channel]].numbers(path, names[channel]) * source.factor
            for channel, source in self._sources.items()
        }
        timing = {channel: content.timing[name] for channel, name in names.items() if name in content.timing}
        side_by_side = aligned(path, {channel: own for channel, own in values.items() if channel != "fs"}, timing)
        values |= side_by_side.values
        raw = RawRecord({}, values.get("t"), side_by_side.sample_rate)
        if "fs" in values:
            if values["fs"].size != 1:
                raise RecordError(f"{path}: fs={names['fs']} has {values['fs'].size} values; give one sample rate [Hz]")
            raw.sample_rate = float(values["fs"].item())
        require_agreement(path, raw.sample_rate, sample_rate)
        raw.sample_rate = raw.sample_rate or sample_rate
        if raw.t is None and raw.sample_rate is None:
            raise RecordError(f"{path}: the map names neither t nor fs; map one of them, or give the sample rate [Hz]")
        lengths = {channel: len(array) for channel, array in values.items() if channel != "fs"}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{channel}={names[channel]} {n}" for channel, n in lengths.items())
            raise RecordError(f"{path}: the mapped columns have different lengths ({found}); map columns of one length")
        raw.gather(values)
        raw.findings = [*self._findings(names, columns), *side_by_side.findings, *content.findings]
        return raw

    def _name(self, path: Path, channel: str, columns: Mapping[str, object], content: Content) -> str:
        """Name of the column that a channel is read from."""
        wanted, names = self._sources[channel].column, list(columns)
        if wanted in columns:
            return wanted
        if content.aliases.get(wanted) in columns:
            return content.aliases[wanted]
        require_unique(path, channel, wanted, content.shared)
        if wanted.isdecimal() and 1 <= int(wanted) <= len(names):
            return names[int(wanted) - 1]
        present = ", ".join(f"{k} {name}" if name != str(k) else name for k, name in enumerate(names, start=1))
        raise RecordError(f"{path}: map {channel}={wanted}: there is no such column; the columns are {present}")

    def _findings(self, names: Mapping[str, str], columns: Mapping[str, _Column]) -> list[Finding]:
        mapped = COLUMNS_MAPPED(
            count=len(names),
            channels=list(names),
            columns=list(names.values()),
            factors=[source.factor for source in self._sources.values()],
        )
        turned = [TRANSPOSED(name=name) for name in sorted({n for n in names.values() if columns[n].is_row})]
        return [mapped, *turned, *unused(COLUMNS_NOT_USED, (name for name in columns if name not in names.values()))]

    def __repr__(self) -> str:
        sources = self._sources | self._columns
        return f"ChannelMap({', '.join(f'{c}={s.column}:{s.factor:g}' for c, s in sources.items())})"


def as_map(given: ChannelMap | Mapping[str, str] | None) -> ChannelMap | None:
    """The map itself, or that of these channels; None where nothing was given."""
    return given if given is None or isinstance(given, ChannelMap) else ChannelMap(given)


def _source(channel: str, text: str) -> _Source:
    if channel not in ("t", "fs", *RESPONSE_COLUMNS) and Channel.of(channel) is None:
        raise InputError(
            f"map {channel}={text}: {channel!r} is no channel; expected t, fs, or one of {', '.join(SIGNALS)} with an "
            f"axis or sensor, such as {EXAMPLE}"
        )
    column, colon, tail = text.rpartition(":")
    try:
        factor = float(tail) if colon and column else 1.0
    except ValueError:
        return _Source(text, 1.0)
    if not np.isfinite(factor) or factor == 0.0:
        raise InputError(f"map {channel}={text}: the factor {tail} makes no SI units; expected a number such as 1e-6")
    return _Source(column, factor, is_stated=True) if colon and column else _Source(text, 1.0)


@dataclass(frozen=True)
class _Column:
    """A column of numbers: an array, or one column of a matrix, or one row of a matrix that is wider than long."""

    array: NDArray[Any] | Stored | NotNumbers
    index: int | None = None
    is_row: bool = False

    def numbers(self, path: Path, name: str) -> NDArray[np.float64]:
        values = numbers(path, name, self.array)
        return values.ravel() if self.index is None else values[self.index] if self.is_row else values[:, self.index]


def _columns(content: Content) -> dict[str, _Column]:
    """All columns of numbers by name, matrices column by column; of a table those of text too, which count."""
    columns: dict[str, _Column] = {}
    for name, value in content.arrays.items():
        if isinstance(value, NotNumbers) or content.is_table and isinstance(value, Stored):
            columns[name] = _Column(value)
            continue
        array = value if isinstance(value, Stored) else np.asarray(value)
        if array.dtype.kind not in "iufb" or len(array.shape) > 2 or 0 in array.shape:
            continue
        if len(array.shape) < 2 or 1 in array.shape:
            columns[name] = _Column(array)
            continue
        is_row = array.shape[0] < array.shape[1]
        count = min(array.shape)
        columns |= {f"{name}[{k + 1}]": _Column(array, k, is_row) for k in range(count)}
    return columns
