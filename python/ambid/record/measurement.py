"""What was measured of the closed loop, over time or over frequency, whichever a file holds.

Measurements that are given twice, by whatever name, are found by their content, since both would be counted.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Protocol

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.findings import Finding, Kind
from ambid.record.channel_map import ChannelMap, as_map
from ambid.record.frequency_readers import holds_response
from ambid.record.frequency_response import FrequencyResponse
from ambid.record.record import Record
from ambid.record.static_loading import StaticLoading
from ambid.rig import Rig

Measurement = Record | FrequencyResponse
Source = Measurement | str | Path
"""A measurement, or the path of its file."""

COUNTED_TWICE = Kind(
    "counted_twice",
    "warning",
    "{source} holds the same data as {other}: they count twice, and standard errors are too small (root 2 of two)",
    "leave one out",
)
FITTED_TO = Kind(
    "validation_is_fitted_to",
    "warning",
    "{source}, to validate on, holds the same data as {other}, which the model is fitted to: its misfit is that of the "
    "fit, and says nothing else",
    "validate on another record",
)

SAME = 1e-6
"""Part of the range of a channel by which a file may round what another one holds: noise is far above it."""


def measured(sources: Source | Sequence[Source], rig: Rig) -> tuple[Measurement, ...]:
    """One measurement or several; files are read as those of a rig. One that is given twice has a finding on that."""
    several = (sources,) if isinstance(sources, Source) else tuple(sources)
    read = [own if isinstance(own, Measurement) else load_measurement(own, rig) for own in several]
    return with_repeats_found(read)


def load_measurement(
    path: str | Path,
    rig: Rig | None = None,
    *,
    period: int | None = None,
    mapping: ChannelMap | Mapping[str, str] | None = None,
    sample_rate: float | None = None,
    allow: Collection[str] = (),
) -> Measurement:
    """Read a record or frequency responses, as `Record.load` and `FrequencyResponse.load` do.

    Frequency responses are .uff and .unv files, .csv with a column and .mat with a variable ``frequency_hz``; `period`,
    `sample_rate` and `allow` say nothing of them.
    """
    mapping = as_map(mapping)
    if holds_response(Path(path), mapping):
        return FrequencyResponse.load(path, rig, mapping=mapping)
    return Record.load(path, rig, period=period, mapping=mapping, sample_rate=sample_rate, allow=allow)


class _Named(Protocol):
    @property
    def name(self) -> str: ...

    @property
    def path(self) -> object: ...


def with_repeats_found(records: Sequence[Measurement]) -> tuple[Measurement, ...]:
    """The same measurements, with a finding on each that holds what one before it does.

    They are not refused: a person may weigh a measurement so. The intervals then are too narrow.
    """
    read: list[Measurement] = []
    for k, record in enumerate(records):
        other = next((own for own in islice(records, k) if _is_same(own, record)), None)
        found = () if other is None else (_of_two(COUNTED_TWICE, record, other),)
        is_known = all(own in record.findings for own in found)
        read.append(record if is_known else replace(record, findings=(*record.findings, *found)))
    return tuple(read)


def findings_of_validation(records: Sequence[Measurement], validate: Sequence[Measurement]) -> list[Finding]:
    """A finding on each record for validation that is one of those that a model is fitted to."""
    return [_of_two(FITTED_TO, kept, own) for kept in validate for own in records if _is_same(own, kept)]


def findings_of_loadings(loadings: Sequence[StaticLoading]) -> list[Finding]:
    """A finding on each static loading that holds the same steps as one before it."""
    findings = []
    for k, own in enumerate(loadings):
        before = (
            one
            for one in loadings[:k]
            if all(_are_alike(getattr(one, name), getattr(own, name)) for name in ("z", "force", "i_c"))
        )
        findings += [_of_two(COUNTED_TWICE, own, one) for one in islice(before, 1)]
    return findings


def findings_of_repeats(records: Sequence[Measurement]) -> list[Finding]:
    """Those findings of measurements that `with_repeats_found` made."""
    return [found for record in records for found in record.findings if found.code == COUNTED_TWICE.code]


def _of_two(kind: Kind, own: _Named, other: _Named) -> Finding:
    return kind(source=str(own.path or own.name), other=str(other.path or other.name))


def _is_same(one: Measurement, other: Measurement) -> bool:
    """Whether two measurements hold the same values in all that both have."""
    if one.is_in_time and other.is_in_time:
        if one.axes != other.axes or abs(one.sample_rate - other.sample_rate) > SAME * one.sample_rate:
            return False
        ours, theirs = one.columns(), other.columns()
        is_seen_twice = not set(one.channels).isdisjoint(other.channels)  # not the excitation of both alone
        return is_seen_twice and all(_are_alike(ours[name], theirs[name]) for name in ours if name in theirs)
    if one.is_in_time or other.is_in_time or (one.outputs, one.inputs) != (other.outputs, other.inputs):
        return False
    return _are_alike(one.frequency_hz, other.frequency_hz) and _are_alike(one.response, other.response)


def _are_alike(one: FloatArray | ComplexArray, other: FloatArray | ComplexArray) -> bool:
    """Whether two tables are the same but for the rounding of a file; NaN in both is alike."""
    if one.shape != other.shape or not one.size:
        return False
    if one is other:
        return True
    # samples by which two long records are distinguished before all of them are compared
    few = slice(None, None, max(1, len(one) // 64))
    for rows in (few, slice(None)):
        a, b = one[rows], other[rows]
        size = np.nanmax(np.abs(a - a[:1]), axis=0, initial=0.0)
        apart = np.abs(a - b)
        if not np.array_equal(np.isnan(a), np.isnan(b)) or np.any(apart > SAME * size):
            return False
    return True
