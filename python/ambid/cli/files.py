"""Files that commands read."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

import ambid
from ambid.errors import InputError

NO_RECORD = "no record follows; name the records of this operating point after its rig file"


def load_model(rig: ambid.Rig, path: Path | None) -> ambid.Model:
    """The rig's nominal model, or a saved one on this rig."""
    return ambid.Model(rig) if path is None else ambid.Model.load(path, rig)


def in_time(records: Sequence[ambid.Record | ambid.FrequencyResponse]) -> list[ambid.Record]:
    """Those that are no frequency responses."""
    return [record for record in records if isinstance(record, ambid.Record)]


def require_first_point(rig: Path, paths: Sequence[Path]) -> None:
    """Refuse to fit the parameters of an operating point that no record is from.

    Raises
    ------
    InputError
        If another rig file comes before the first record.
    """
    if paths and paths[0].suffix.lower() == ".toml":
        raise InputError(
            f"{rig}: {NO_RECORD}, before {paths[0]}; leave this one out if there are none, and begin with {paths[0]}"
        )


def load_records(
    rig: ambid.Rig,
    paths: list[Path],
    period: int | None,
    columns: list[str],
    sample_rate: float | None,
    allow: Sequence[str] = (),
) -> list[ambid.Record | ambid.FrequencyResponse]:
    """Records and frequency responses of a rig; `columns` are options as `ChannelMap.parse` reads them.

    A rig file among them opens another operating point of the machine: the records after it were recorded there.
    """
    if sample_rate is not None and not (np.isfinite(sample_rate) and sample_rate > 0.0):
        raise InputError(f"--sample-rate {sample_rate:g}: expected a positive number of Hz")
    mapping = ambid.ChannelMap.parse(columns) if columns else None
    found: list[ambid.Record | ambid.FrequencyResponse] = []
    point = rig
    for path, after in pairwise([*paths, Path()]):
        if path.suffix.lower() == ".toml":
            point = ambid.Rig.load(path)
            if after.suffix.lower() in (".toml", ""):
                raise InputError(f"{path}: {NO_RECORD}")
            continue
        record = ambid.load_measurement(
            path, point, period=period, mapping=mapping, sample_rate=sample_rate, allow=allow
        )
        found.append(record if point is rig else record.at(point))
    return found
