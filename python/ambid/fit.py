"""How well a simulated response matches a measured one, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.arrays import FloatArray
from ambid.record import Record, noise_ceiling


def measured_outputs(record: Record) -> FloatArray:
    """Stack the recorded y and i_c as the loop's outputs, shape (N, 2 axes); zeros where i_c was not recorded."""
    i_c = np.zeros_like(record.y) if record.i_c is None else record.i_c
    return np.hstack([record.y, i_c])


def recorded_channels(record: Record) -> list[str]:
    """Names of the loop's outputs that the record holds, in order."""
    signals = ["y"] if record.i_c is None else ["y", "i_c"]
    return [f"{signal}.{axis}" for signal in signals for axis in record.axes]


def fit_percent(
    channels: Sequence[str], measured: Sequence[FloatArray], simulated: Sequence[FloatArray]
) -> dict[str, float]:
    """``100 (1 - |z - zhat| / |z - mean z|)`` of each channel, each record's mean removed from both.

    Parameters
    ----------
    channels : sequence of str
        The first columns of the arrays.
    measured, simulated : sequence of ndarray, shape (N, columns)
        One per record; several records count as one long one.

    Returns
    -------
    dict
        Per channel, and ``average`` over the displacements y.
    """
    missed, total = np.zeros(len(channels)), np.zeros(len(channels))
    for z, zhat in zip(measured, simulated, strict=True):
        own = z[:, : len(channels)] - z[:, : len(channels)].mean(axis=0)
        residual = own - (zhat[:, : len(channels)] - zhat[:, : len(channels)].mean(axis=0))
        missed += np.einsum("kc,kc->c", residual, residual)
        total += np.einsum("kc,kc->c", own, own)
    fit = dict(zip(channels, (100.0 * (1.0 - np.sqrt(missed / total))).tolist(), strict=True))
    return with_average(fit)


def pooled_ceiling(records: Sequence[Record], channels: Sequence[str]) -> dict[str, float]:
    """Noise ceiling [%] of channels over all records as one long one, and ``average``, see `noise_ceiling`."""
    missed, total = np.zeros(len(channels)), np.zeros(len(channels))
    for record in records:
        ceilings = noise_ceiling(record)
        power = measured_outputs(record)[:, : len(channels)].var(axis=0) * record.samples
        missed += (1.0 - np.array([ceilings[c] for c in channels]) / 100.0) ** 2 * power
        total += power
    return with_average(dict(zip(channels, (100.0 * (1.0 - np.sqrt(missed / total))).tolist(), strict=True)))


def with_average(per_channel: dict[str, float]) -> dict[str, float]:
    """Add ``average`` over the displacements y."""
    of_y = [value for channel, value in per_channel.items() if channel.startswith("y.")]
    return {**per_channel, "average": float(np.mean(of_y))}
