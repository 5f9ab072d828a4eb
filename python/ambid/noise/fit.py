"""How well a simulated response matches a measured one, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.arrays import FloatArray


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


def with_average(per_channel: dict[str, float]) -> dict[str, float]:
    """Add ``average`` over the displacements y."""
    of_y = [value for channel, value in per_channel.items() if channel.startswith("y.")]
    return {**per_channel, "average": float(np.mean(of_y))}
