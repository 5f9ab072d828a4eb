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

    Smooth noise of what the controller reads shows in y and i_c with every pole of the loop: that of the sensors, and
    of the current readings where it reads those, else they show it in i_c alone. Taken back by the inverse, the noise
    of a record is smooth over frequency again.

    Parameters
    ----------
    model : Model
        At the operating point of the record; nonlinear effects of it are linearised at rest.
    points : ndarray of complex
        Lines as points of the unit circle.
    channels : int
        Of y and i_c, or of y alone.
    """
    loop, read = _with_noise(model, channels)
    way = np.tile(np.eye(channels, dtype=complex), (len(points), 1, 1))
    with suppress(UnstableLoopError):  # at the edge of stability no shape is of help
        way[:, :, : len(read)] = loop.transfer(model.theta, points)[:, :channels, read]
    return way


def back_through_loop(
    model: Model, points: ComplexArray, channels: int, *, currents_are_read: bool = True
) -> ComplexArray:
    """The inverse of `loop_noise`.

    Without `currents_are_read` of readings of i_c that the controller has not: they are recorded by other instruments.
    """
    loop, read = _with_noise(model, channels)
    if not currents_are_read:
        read = read[: len(model.rig.axes)]
    try:
        return _core.way_back(loop.core, model.theta, points, read, channels)
    except UnstableLoopError:
        return np.tile(np.eye(channels, dtype=complex), (len(points), 1, 1))


def _with_noise(model: Model, channels: int) -> tuple[Loop, list[int]]:
    """The loop with inputs for noise, and which of them are those of the channels that the controller reads."""
    loop = model.with_noise_inputs()
    of_y, of_i_c = ([k for k, name in enumerate(loop.inputs) if name.startswith(kind)] for kind in ("n.", "n_i."))
    return loop, (of_y + of_i_c)[:channels]
