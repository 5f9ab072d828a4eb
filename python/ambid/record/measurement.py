"""What was measured of the closed loop, over time or over frequency, whichever a file holds."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from ambid.record.channel_map import ChannelMap
from ambid.record.frequency_readers import holds_response
from ambid.record.frequency_response import FrequencyResponse
from ambid.record.record import Record
from ambid.record.twice import with_repeats_found
from ambid.rig import Rig

__all__ = ["Measurement", "Source", "load_measurement", "measured"]

Measurement = Record | FrequencyResponse
Source = Measurement | str | Path
"""A measurement, or the path of its file."""


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
    if mapping is not None and not isinstance(mapping, ChannelMap):
        mapping = ChannelMap(mapping)
    if holds_response(Path(path), mapping):
        return FrequencyResponse.load(path, rig, mapping=mapping)
    return Record.load(path, rig, period=period, mapping=mapping, sample_rate=sample_rate, allow=allow)
