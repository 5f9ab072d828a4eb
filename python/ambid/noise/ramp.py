"""A slow ramp of y and i_c: the path of a record through set-points, speeds or loads, which is no noise.

A path that is slow beside the loop is a polynomial of time, and what its beginning leaves is a transient. On lines it
stands as 1/l, over hundreds of the lowest ones that noise is taken from, and hides there what is missing. Where it is
most of what the model leaves of the lowest lines, it is fitted beside the transient, and taken out of the record.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import UnstableLoopError
from ambid.model import Model
from ambid.noise.colour import back_through_loop
from ambid.noise.transients import OWN, freed, orthonormal
from ambid.noise.window import Window
from ambid.record import Record

__all__ = ["without_ramp"]

LOWEST = 200
"""Lines that a ramp is looked for on, from the lowest on: further up less than a ten-thousandth of its power is."""
SEVERAL = 4
"""Periods from which on the lines that are not excited tell a ramp alone; of fewer they are too far apart."""
PLAIN = 3
"""Degree of a polynomial that follows any ramp well enough to see that there is one."""
CLEAR = 10.0
"""Power that the model leaves of these lines, over what is left of it beside a plain ramp, from which on there is one.
Noise stays below 1.2, and missing physics, whose residual is no polynomial of time, below 2."""
MOST = 10
"""Highest degree of what is taken out: a path that goes forth and back, to a hundred-thousandth."""
ENOUGH = 1.2
"""Power that is left, over that beside a polynomial of the highest degree, with which a lower one will do."""


def without_ramp(here: Model, record: Record) -> Record:
    """The record without the slow ramp of its y and i_c, with a note; itself where none stands clearly above the rest.

    Parameters
    ----------
    here : Model
        At the operating point of the record; nonlinear effects of it are linearised at rest.
    record : Record
    """
    window = Window.of(record)
    is_between = window.periods >= SEVERAL
    index = window.between(window.periods) if is_between else np.arange(1, (window.samples + 1) // 2)
    index = index[:LOWEST]
    time = (2.0 * (np.arange(record.samples) - window.first) + 1.0) / window.samples - 1.0
    path = legvander(time, MOST)[:, 1:]
    try:
        left, columns = _beside_others(here, record, window, index, window.lines(path)[index], is_between=is_between)
    except UnstableLoopError:  # it has no transient
        return record
    p = len(record.channels)
    bases = [orthonormal(columns[:, : degree * p]) for degree in range(MOST + 1)]
    power = [float(left @ left - np.sum((basis.T @ left) ** 2)) for basis in bases]
    if power[0] < CLEAR * power[PLAIN]:
        return record
    degree = next(k for k, own in enumerate(power) if own < ENOUGH * power[MOST])
    size = np.linalg.norm(columns[:, : degree * p], axis=0)
    amplitudes = np.linalg.lstsq(columns[:, : degree * p] / size, left, rcond=np.sqrt(OWN))[0] / size
    ramp = path[:, :degree] @ amplitudes.reshape(degree, p)
    y, i_c = np.split(record.outputs - ramp, [len(record.axes)], axis=1)
    told = ", ".join(f"{c} by {size:.3g}" for c, size in zip(record.channels, np.ptp(ramp, axis=0), strict=True))
    note = f"a slow ramp was taken out, a polynomial of degree {degree} over the record ({told}; SI units): no noise"
    return replace(record, y=y, i_c=None if record.i_c is None else i_c, notes=(*record.notes, note))


def _beside_others(
    here: Model, record: Record, window: Window, index: NDArray[np.intp], path: ComplexArray, *, is_between: bool
) -> tuple[FloatArray, FloatArray]:
    """What the model leaves of lines, and paths of every channel, (numbers, degrees p), freed from all else.

    Taken back through the loop, noise is even. All else is a transient, and what a model that is wrong at these low
    frequencies leaves of the excitation: a gain with a slope.
    """
    core, p, points = here.loop.core, len(record.channels), window.points(index)
    z, inputs = (window.lines(own)[index] for own in (record.outputs, here.excitation(record)))
    back = back_through_loop(here, points, p)
    size = np.sqrt(np.median(np.abs(_core.through(back, z)) ** 2, axis=0))
    back /= np.where(size > 0.0, size, 1.0)[:, None]
    data = _core.LineData(core, points, inputs, z, back)
    rows = data.rows(core, here.theta, [], np.zeros(0), True)
    others = [rows[:, :-1]]
    if not is_between:
        slope = 1j * index[:, None] / index[-1]
        others.append(_of_every_channel(back, np.hstack([inputs, slope * inputs])))
    known = orthonormal(np.hstack(others))
    return freed(-rows[:, -1], known), freed(_of_every_channel(back, path), known)


def _of_every_channel(back: ComplexArray, lines: ComplexArray) -> FloatArray:
    """Lines of shape (lines, q) in each channel, whitened, as real numbers, shape (numbers, q p)."""
    columns = back[:, :, None, :] * lines[:, None, :, None]
    flat = columns.reshape(*back.shape[:2], -1)
    return np.stack([flat.real, flat.imag], axis=2).reshape(-1, flat.shape[-1])
