"""Where and by how much a model misses what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import RecordError
from ambid.model import Model
from ambid.noise import noise_ceiling
from ambid.noise.fit import fit_percent, with_average
from ambid.noise.whitener import Whitener, channel_misfit
from ambid.noise.window import Window
from ambid.record import Record
from ambid.results import Tabular, plain
from ambid.threads import with_one_blas_thread

__all__ = ["ChannelComparison", "Comparison", "RecordComparison", "compare"]


@dataclass(frozen=True)
class ChannelComparison:
    """One channel of one record against the model.

    Attributes
    ----------
    channel : str
        Such as ``y.A_zeta``.
    unit : str
    fit_percent, noise_ceiling_percent : float
        Reached, and reachable by the exact model; NaN without enough periods.
    residual_rms, noise_rms : float
        In `unit`, means removed; the noise is the scatter over the periods.
    misfit : float
        J/dof of this channel alone: 1 when nothing is left but noise; NaN where the noise is not known.
    """

    channel: str
    unit: str
    fit_percent: float
    noise_ceiling_percent: float
    residual_rms: float
    noise_rms: float
    misfit: float


@dataclass(frozen=True, repr=False)
class RecordComparison:
    """One record against the model.

    Attributes
    ----------
    record : Record
    simulated : ndarray, shape (N, channels)
    channels : tuple of ChannelComparison
    misfit : float
        J/dof of y and i_c judged jointly; NaN where the noise is not known: two periods, too short, or without noise.
    repeatable_share : float
        Part of the excited lines' power that is no noise: ``max(0, (J - dof)/J)``.
    """

    record: Record
    simulated: FloatArray
    channels: tuple[ChannelComparison, ...]
    misfit: float
    repeatable_share: float

    @property
    def residual(self) -> FloatArray:
        """Measured minus simulated, means removed, shape (N, channels)."""
        left = self.record.outputs - self.simulated
        return left - left.mean(axis=0)


@dataclass(frozen=True, repr=False)
class Comparison(Tabular):
    """All records against the model; result of `compare`."""

    model: Model
    records: tuple[RecordComparison, ...]

    @property
    def worst(self) -> tuple[str, ChannelComparison]:
        """The record and channel whose residual is largest in units of its noise."""
        pairs = [(r.record.name, c) for r in self.records for c in r.channels]
        return max(pairs, key=lambda pair: pair[1].residual_rms / pair[1].noise_rms if pair[1].noise_rms > 0 else 0.0)

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        return plain({"records": [_as_dict(record) for record in self.records]})

    def table(self) -> dict[str, list[Any]]:
        """Channels of all records, a row each."""
        rows = [(r.record.name, c) for r in self.records for c in r.channels]
        columns = [f.name for f in fields(ChannelComparison)]
        return {"record": [name for name, _ in rows]} | {
            column: [getattr(c, column) for _, c in rows] for column in columns
        }

    def summary(self) -> list[str]:
        """Misfit and notes of every record."""
        return [
            line
            for r in self.records
            for line in (f"{r.record.name}: misfit {r.misfit:.2f} (J/dof, 1 when the model is right)", *r.record.notes)
        ]

    def __repr__(self) -> str:
        lines = []
        for record in self.records:
            lines += [
                f"{record.record.name}: misfit {record.misfit:.2f} (J/dof, 1 when the model is right), "
                f"{100 * record.repeatable_share:.0f} % of the residual on excited lines repeats",
                f"{'channel':12s} {'fit %':>8s} {'ceiling %':>10s} {'residual rms':>15s} "
                f"{'noise rms':>13s} {'misfit':>8s}",
            ]
            for c in record.channels:
                factor, unit = (1e6, "um") if c.unit == "m" else (1e3, "mA")
                lines.append(
                    f"{c.channel:12s} {c.fit_percent:8.2f} {c.noise_ceiling_percent:10.2f} "
                    f"{c.residual_rms * factor:12.4g} {unit} {c.noise_rms * factor:10.4g} {unit} {c.misfit:8.2f}"
                )
        return "\n".join(lines)


@with_one_blas_thread
def compare(model: Model, records: Record | Sequence[Record]) -> Comparison:
    """Simulate each record's experiment and hold the result against the measurement.

    Parameters
    ----------
    model : Model
        As it stands; nothing is fitted.
    records : Record or sequence of Record

    Returns
    -------
    Comparison

    Raises
    ------
    UnstableLoopError
        If the model's loop is unstable.
    RecordError
        If a record has other axes than the rig, or no excitation.
    """
    records = (records,) if isinstance(records, Record) else tuple(records)
    return Comparison(model, tuple(_one(model, record) for record in records))


def _one(model: Model, record: Record) -> RecordComparison:
    if record.axes != model.rig.axes:
        where, rig_axes = record.path or record.name, ", ".join(model.rig.axes)
        raise RecordError(
            f"{where}: axes {', '.join(record.axes)}, the rig has {rig_axes}; load the record with its rig"
        )
    channels, measured = record.channels, record.outputs
    simulated = model.response(record)[:, : len(channels)]
    fit = fit_percent(channels, [measured], [simulated])
    ceiling = noise_ceiling(record)
    residual = measured - simulated
    residual -= residual.mean(axis=0)
    deviation = measured.std(axis=0)
    single, joint, share = np.full(len(channels), np.nan), np.nan, np.nan
    with suppress(RecordError):  # two periods, too short, or no noise: then what is left has no unit
        window, excitation = Window.of(record), model.excitation(record)[:, : len(record.axes)]
        single = channel_misfit(residual, window, excitation)
        white = Whitener.from_residual(residual, window, excitation).whiten(residual)
        joint = float(np.sum(white**2) / white.size)
        share = max(0.0, 1.0 - 1.0 / joint)
    rows = tuple(
        ChannelComparison(
            channel=channel,
            unit="m" if channel.startswith("y.") else "A",
            fit_percent=fit[channel],
            noise_ceiling_percent=ceiling[channel],
            residual_rms=float(residual[:, k].std()),
            noise_rms=float((1.0 - ceiling[channel] / 100.0) * deviation[k]),
            misfit=float(single[k]),
        )
        for k, channel in enumerate(channels)
    )
    return RecordComparison(record, simulated, rows, joint, share)


def _as_dict(record: RecordComparison) -> dict[str, Any]:
    fit = with_average({c.channel: c.fit_percent for c in record.channels})
    ceiling = with_average({c.channel: c.noise_ceiling_percent for c in record.channels})
    return {
        "record": record.record.name,
        "fit_percent": fit,
        "noise_ceiling_percent": ceiling,
        "misfit": record.misfit,
        "repeatable_share": record.repeatable_share,
        "channels": [
            {
                "channel": c.channel,
                "unit": c.unit,
                "residual_rms": c.residual_rms,
                "noise_rms": c.noise_rms,
                "misfit": c.misfit,
            }
            for c in record.channels
        ],
        "notes": list(record.record.notes),
    }
