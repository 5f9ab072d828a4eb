"""How the loop shapes the noise of its sensors."""

from __future__ import annotations

import numpy as np

from ambid.arrays import ComplexArray
from ambid.model import Model

__all__ = ["loop_noise"]


def loop_noise(model: Model, samples: int, channels: int) -> ComplexArray:
    """The way from noise of the instruments to y and i_c, shape (samples / 2 + 1, channels, channels).

    Smooth noise of the sensors shows in y and i_c with every pole of the loop, noise of the current readings in i_c
    alone. Taken back by the inverse, the noise of a record is smooth over frequency again.

    Parameters
    ----------
    model : Model
        At the operating point of the record; nonlinear effects of it are linearised at rest.
    samples : int
        Of the record, at the rig's sample rate; its spectrum has samples / 2 + 1 lines.
    channels : int
        Of y and i_c, or of y alone.
    """
    loop = model.with_noise_inputs()
    axes = len(model.rig.axes)
    frequency = np.arange(samples // 2 + 1) * model.rig.sample_rate / samples
    sensors = [k for k, name in enumerate(loop.inputs) if name.startswith("n.")]
    way = np.tile(np.eye(channels, dtype=complex), (len(frequency), 1, 1))
    way[1:, :, :axes] = loop.frequency_response(model.theta, frequency[1:])[:, :channels, sensors]
    return way
