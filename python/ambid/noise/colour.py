"""How the loop shapes the noise of its sensors."""

from contextlib import suppress

import numpy as np

from ambid import _core
from ambid.arrays import ComplexArray
from ambid.errors import UnstableLoopError
from ambid.loop.loop import Loop
from ambid.model import Model


def loop_noise(model: Model, points: ComplexArray, channels: int) -> ComplexArray:
    """The way from noise of the instruments to the outputs of a record, shape (points, channels, channels).

    Smooth noise of what the controller reads shows in all of them with every pole of the loop: that of the sensors, and
    of the current readings where it reads those. That of every other channel shows in itself alone. Taken back by the
    inverse, the noise of a record is smooth over frequency again. Where y was not recorded, i_c shows the noise of the
    sensors that the controller read.

    Parameters
    ----------
    model : Model
        At the operating point of the record; nonlinear effects of it are linearised at rest.
    points : ndarray of complex
        Lines as points of the unit circle.
    channels : int
        Of the record, which are the first outputs of the loop.
    """
    loop, read = inputs_of_noise(model, channels)
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
    loop, read = inputs_of_noise(model, channels)
    if not currents_are_read:
        read = read[: len(model.rig.axes)]
    try:
        return _core.way_back(loop.core, model.theta, points, read, channels)
    except UnstableLoopError:
        return np.tile(np.eye(channels, dtype=complex), (len(points), 1, 1))


def inputs_of_noise(model: Model, channels: int) -> tuple[Loop, list[int]]:
    """The loop with inputs for noise, and which of them are those of its first outputs that the controller reads."""
    loop = model.with_noise_inputs()
    axes = model.rig.axes
    shows = {"y": "n", "i_c": "n_i"} if f"y.{axes[0]}" in loop.outputs[:channels] else {"i_c": "n"}
    of = {f"{read}.{axis}": f"{noise}.{axis}" for read, noise in shows.items() for axis in axes}
    read = [of[name] for name in loop.outputs[:channels] if of.get(name) in loop.inputs]
    return loop, [loop.inputs.index(name) for name in read]
