"""Figures of several channels and their average."""

from __future__ import annotations

import numpy as np


def with_average(per_channel: dict[str, float]) -> dict[str, float]:
    """Add ``average`` over the displacements y; NaN where there are none."""
    of_y = [value for channel, value in per_channel.items() if channel.startswith("y.")]
    return {**per_channel, "average": float(np.mean(of_y)) if of_y else np.nan}
