"""What a controller reads; the analog one, folded into the LFT of the plant; errors of the gains of any controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ambid.arrays import ComplexArray, FloatArray, StateSpace
from ambid.errors import ModelError
from ambid.loop.assembly import Lft, Port
from ambid.loop.delay import with_late_commands
from ambid.loop.plant import HEARD
from ambid.loop.response import frequency_response
from ambid.rig import Controller, Rig


@dataclass(frozen=True)
class LawError:
    """What the error e that fills a slot adds to the commands: ``e (-(C x + D read) + excitation i_e)``.

    Attributes
    ----------
    slot : str
    C : ndarray, shape (axes, states of the controller)
    D : ndarray, shape (axes, signals read)
    excitation : ndarray, shape (axes, axes)
        Zero of an error of the controller.
    """

    slot: str
    C: FloatArray
    D: FloatArray
    excitation: FloatArray


@dataclass(frozen=True)
class Reading:
    """What a controller reads: ``outputs`` times the plant's outputs plus ``inputs`` times its inputs.

    Attributes
    ----------
    outputs : ndarray, shape (signals read, outputs)
    inputs : ndarray, shape (signals read, inputs)
        -1 where a reference is taken off.
    """

    outputs: FloatArray
    inputs: FloatArray

    @classmethod
    def of(cls, rig: Rig, outputs: Sequence[str], inputs: Sequence[str]) -> Reading:
        """Of a rig's controller, among signals of these names."""
        own = rig.controller
        share = {"y": -float(own.reference), "r": 1.0}
        read = [(signal, axis) for signal in own.signals for axis in rig.axes]
        of_outputs, of_inputs = np.zeros((len(read), len(outputs))), np.zeros((len(read), len(inputs)))
        for row, (signal, axis) in enumerate(read):
            name = f"{signal}.{axis}"
            if (own_name := next((n for n in (f"{HEARD}{name}", name) if n in outputs), None)) is not None:
                of_outputs[row, outputs.index(own_name)] = 1.0  # the first: what is watched may be there again
            if (name := f"r.{axis}") in inputs:
                of_inputs[row, inputs.index(name)] = share.get(signal, 0.0)
        return cls(of_outputs, of_inputs)


def of_reference(rig: Rig, points: ComplexArray) -> ComplexArray:
    """What the controller makes of the reference r, as part of i_e, at points of the unit circle, (points, axes, axes).

    An analog one as if it saw r between its samples; a faster digital one likewise in its own.
    """
    own, axes, rate = rig.controller, len(rig.axes), rig.sample_rate
    steps = own.rate(rate) / rate
    response = frequency_response(
        own.state_space(axes, rate), points ** (1.0 / steps) if own.is_digital else rate * np.log(points)
    )
    reading = Reading.of(rig, (), [f"r.{axis}" for axis in rig.axes])
    return -response @ reading.inputs


def law_errors(plant: Lft, rig: Rig) -> list[LawError]:
    """The gain errors of a plant as its rig's controller takes them; gains that it has not are left out."""
    found = []
    acts = np.eye(len(rig.axes)) if plant.excitation is None else plant.excitation
    for error in plant.gain_errors:
        c, d = _part_of(rig.controller, error.gain, len(rig.axes), rig.sample_rate)
        excitation = acts * np.isin(rig.axes, error.axes)
        own = LawError(error.slot, c, d, np.ascontiguousarray(excitation))
        if any(part.any() for part in (c, d, excitation)):
            found.append(own)
    return found


@lru_cache(maxsize=64)
def _part_of(controller: Controller, gain: str, axes: int, sample_rate: float) -> tuple[FloatArray, FloatArray]:
    """See `Controller.part_of`, as the core wants it; many loops have the same controller."""
    c, d = controller.part_of(gain, axes, sample_rate)
    return np.ascontiguousarray(c), np.ascontiguousarray(d)


def close_analog(
    plant: Lft,
    rig: Rig,
    controller: StateSpace,
    errors: Sequence[LawError] = (),
) -> Lft:
    """Close ``i_ref = -K read + i_e`` around the plant, what is read being ``y - r``, and i_c where K reads that.

    Parameters
    ----------
    plant : Lft
        Its first inputs are the commands i_ref of n axes, its first n outputs the displacements y; what K reads does
        not follow a command at once. Of a plant with a delay the feedback comes late in it already, and i_e has yet to
        be delayed.
    rig : Rig
        Whose controller K is.
    controller : tuple of ndarray
        A, B, C, D of K.
    errors : sequence of LawError
        They become further ports.

    Returns
    -------
    Lft
        Inputs ``i_e.<axis>``, as recorded, and further ones of the plant such as ``r.<axis>``.

    Raises
    ------
    ModelError
        If something that K reads follows a command at once.
    """
    a_k, b_k, c_k, d_k = controller
    plant = with_late_commands(plant)
    axes = [name.removeprefix("i_ref.") for name in plant.inputs if name.startswith("i_ref.")]
    n, u, states, control, outputs = len(axes), len(plant.inputs), len(plant.A), len(a_k), len(plant.outputs)
    excited = list(range(n) if plant.late is None else range(u - n, u))
    others = [k for k in range(n, u) if k not in excited]
    rest = [*others, *range(u, plant.B.shape[1])]
    b_u, b_rest = plant.B[:, :n], plant.B[:, rest]
    d_u, d_rest = plant.D[:, :n], plant.D[:, rest]
    reading = Reading.of(rig, plant.outputs, plant.inputs)
    if np.any(reading.outputs @ d_u[:outputs]):
        raise ModelError(f"what the controller reads, {', '.join(rig.controller.signals)}, follows a command at once")
    y_x, y_rest = reading.outputs @ plant.C[:outputs], reading.outputs @ d_rest[:outputs]
    y_rest[:, : len(others)] += reading.inputs[:, others]
    by_x = np.hstack([-d_k @ y_x, -c_k])  # i_ref over the states of plant and controller
    by_rest = -d_k @ y_rest  # and over the other inputs and the Delta ports
    A = np.zeros((states + control, states + control))
    A[:states, :states] = plant.A
    A[:states] += b_u @ by_x
    A[states:, :states] = b_k @ y_x
    A[states:, states:] = a_k
    C = np.hstack([plant.C, np.zeros((len(plant.C), control))]) + d_u @ by_x

    b_rest, d_rest = np.vstack([b_rest + b_u @ by_rest, b_k @ y_rest]), d_rest + d_u @ by_rest
    enters = np.vstack([plant.B[:, excited], np.zeros((control, n))]), plant.D[:, excited]
    acts = np.eye(n) if plant.excitation is None else plant.excitation
    names = (*(f"i_e.{axis}" for axis in axes), *(plant.inputs[k] for k in others))
    B, D = np.hstack([enters[0] @ acts, b_rest]), np.hstack([enters[1] @ acts, d_rest])
    closed = replace(plant, A=A, B=B, C=C, D=D, inputs=names)
    if errors:
        closed = _with_ports(closed, rig, errors, enters, (np.vstack([b_u, np.zeros((control, n))]), d_u))
    heard = [k for k, name in enumerate(closed.outputs) if name.startswith(HEARD)]
    shown = tuple(name for name in closed.outputs if not name.startswith(HEARD))
    return replace(closed, C=np.delete(closed.C, heard, 0), D=np.delete(closed.D, heard, 0), outputs=shown)


def _with_ports(
    closed: Lft,
    rig: Rig,
    errors: Sequence[LawError],
    excites: tuple[FloatArray, FloatArray],
    feeds_back: tuple[FloatArray, FloatArray],
) -> Lft:
    """A closed loop with a port for each error and axis; excitation and feedback enter it by columns of B and D."""
    n, states, inputs, outputs = excites[1].shape[1], len(closed.A), closed.B.shape[1], len(closed.C)
    z, b, d = np.zeros((0, states + inputs)), np.zeros((states, 0)), np.zeros((outputs, 0))
    reading, rows = Reading.of(rig, closed.outputs, closed.inputs), len(closed.outputs)
    read = reading.outputs @ np.hstack([closed.C[:rows], closed.D[:rows]])
    read[:, states : states + len(closed.inputs)] += reading.inputs
    for error in errors:
        seen = -error.D @ read
        seen[:, states - error.C.shape[1] : states] -= error.C
        seen[:, states : states + n] += error.excitation
        enters = excites if error.excitation.any() else feeds_back
        z, b, d = np.vstack([z, seen]), np.hstack([b, enters[0]]), np.hstack([d, enters[1]])
    more, ports = len(z), len(closed.ports)
    column, row = [len(closed.inputs) + ports] * more, [len(closed.outputs) + ports] * more
    B = np.insert(closed.B, column, b, axis=1)
    C = np.insert(closed.C, row, z[:, :states], axis=0)
    # nothing that is read follows a command at once, so that no port follows another
    D = np.insert(np.insert(closed.D, column, d, axis=1), row, np.insert(z[:, states:], column, 0.0, axis=1), axis=0)
    return replace(closed, B=B, C=C, D=D, ports=(*closed.ports, *(Port(e.slot) for e in errors for _ in range(n))))
