"""How the loop shapes the noise of its sensors."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ambid import _core
from ambid.arrays import ComplexArray
from ambid.errors import UnstableLoopError
from ambid.loop.loop import Loop
from ambid.model import Model

__all__ = ["back_through_loop", "loop_noise"]


def loop_noise(model: Model, points: ComplexArray, channels: int) -> ComplexArray:
    """The way from noise of the instruments to y and i_c, shape (points, channels, channels).

    Smooth noise of the sensors shows in y and i_c with every pole of the loop, noise of the current readings in i_c
    alone. Taken back by the inverse, the noise of a record is smooth over frequency again.

    Parameters
    ----------
    model : Model
        At the operating point of the record; nonlinear effects of it are linearised at rest.
    points : ndarray of complex
        Lines as points of the unit circle.
    channels : int
        Of y and i_c, or of y alone.
    """
    loop, sensors = _with_sensors(model)
    way = np.tile(np.eye(channels, dtype=complex), (len(points), 1, 1))
    with suppress(UnstableLoopError):  # at the edge of stability no shape is of help
        way[:, :, : len(sensors)] = loop.transfer(model.theta, points)[:, :channels, sensors]
    return way


def back_through_loop(model: Model, points: ComplexArray, channels: int) -> ComplexArray:
    """The inverse of `loop_noise`."""
    loop, sensors = _with_sensors(model)
    try:
        return _core.way_back(loop.core, model.theta, points, sensors, channels)
    except UnstableLoopError:
        return np.tile(np.eye(channels, dtype=complex), (len(points), 1, 1))


def _with_sensors(model: Model) -> tuple[Loop, list[int]]:
    """The loop with inputs for noise, and which of them are that of the sensors."""
    loop = model.with_noise_inputs()
    return loop, [k for k, name in enumerate(loop.inputs) if name.startswith("n.")]
