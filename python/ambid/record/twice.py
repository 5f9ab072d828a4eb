"""Measurements that are given twice, by whatever name: told by what they hold, since both would be counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from typing import Protocol

import numpy as np

from ambid.arrays import ComplexArray, FloatArray
from ambid.record.frequency_response import FrequencyResponse
from ambid.record.record import Record
from ambid.record.static_loading import StaticLoading

__all__ = ["notes_on_loadings", "notes_on_repeats", "notes_on_validation", "with_repeats_told"]

SAME = 1e-6
"""Part of the range of a channel by which a file may round what another one holds: noise is far above it."""
COUNTED_TWICE = "they count twice, and standard errors are too small, by root 2 of two such; leave one out"
"""What the note on a measurement that is given twice ends with."""
LOOK = 64
"""Samples by which two long records are told apart before all of them are compared."""

Measurement = Record | FrequencyResponse


class _Named(Protocol):
    @property
    def name(self) -> str: ...

    @property
    def path(self) -> object: ...


def with_repeats_told(records: Sequence[Measurement]) -> tuple[Measurement, ...]:
    """The same measurements, with a note on each that holds what one before it does.

    They are not refused: a person may weigh a measurement so. The intervals then are too narrow.
    """
    told: list[Measurement] = []
    for k, record in enumerate(records):
        other = next((own for own in islice(records, k) if _is_same(own, record)), None)
        note = None if other is None else repeated(record, other)
        told.append(record if note is None or note in record.notes else replace(record, notes=(*record.notes, note)))
    return tuple(told)


def repeated(record: _Named, other: _Named) -> str:
    """The note on a measurement that holds what another one does."""
    return f"{record.path or record.name} holds the same data as {other.path or other.name}: {COUNTED_TWICE}"


def notes_on_validation(records: Sequence[Measurement], validate: Sequence[Measurement]) -> list[str]:
    """A note on each record for validation that is one of those that a model is fitted to."""
    pairs = ((kept, own) for kept in validate for own in records if _is_same(own, kept))
    return [
        f"{kept.path or kept.name}, to validate on, holds the same data as {own.path or own.name}, which the model is "
        "fitted to: its misfit is that of the fit, and tells nothing else; validate on another record"
        for kept, own in pairs
    ]


def notes_on_loadings(loadings: Sequence[StaticLoading]) -> list[str]:
    """A note on each static loading that holds the same steps as one before it."""
    notes = []
    for k, own in enumerate(loadings):
        before = (
            one
            for one in loadings[:k]
            if all(_are_alike(getattr(one, name), getattr(own, name)) for name in ("z", "force", "i_c"))
        )
        notes += [repeated(own, one) for one in islice(before, 1)]
    return notes


def notes_on_repeats(records: Sequence[Measurement]) -> list[str]:
    """Those notes of measurements that `with_repeats_told` made."""
    return [note for record in records for note in record.notes if note.endswith(COUNTED_TWICE)]


def _is_same(one: Measurement, other: Measurement) -> bool:
    """Whether two measurements hold the same values in all that both have."""
    if isinstance(one, Record) and isinstance(other, Record):
        if one.axes != other.axes or abs(one.sample_rate - other.sample_rate) > SAME * one.sample_rate:
            return False
        pairs = [(getattr(one, name), getattr(other, name)) for name in ("y", "i_e", "i_c", "r")]
        return all(_are_alike(a, b) for a, b in pairs if a is not None and b is not None)
    if isinstance(one, FrequencyResponse) and isinstance(other, FrequencyResponse):
        if (one.outputs, one.inputs) != (other.outputs, other.inputs):
            return False
        return _are_alike(one.frequency_hz, other.frequency_hz) and _are_alike(one.response, other.response)
    return False


def _are_alike(one: FloatArray | ComplexArray, other: FloatArray | ComplexArray) -> bool:
    """Whether two tables are the same but for the rounding of a file; NaN in both is alike."""
    if one.shape != other.shape or not one.size:
        return False
    if one is other:
        return True
    few = slice(None, None, max(1, len(one) // LOOK))
    for rows in (few, slice(None)):
        a, b = one[rows], other[rows]
        size = np.nanmax(np.abs(a - a[:1]), axis=0, initial=0.0)
        apart = np.abs(a - b)
        if not np.array_equal(np.isnan(a), np.isnan(b)) or np.any(apart > SAME * size):
            return False
    return True
