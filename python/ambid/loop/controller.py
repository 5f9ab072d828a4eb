"""The analog controller, folded into the LFT of the plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ambid.arrays import FloatArray
from ambid.loop.assembly import Lft
from ambid.loop.delay import with_late_commands


def close_analog(plant: Lft, controller: tuple[FloatArray, FloatArray, FloatArray, FloatArray], *, noise: bool) -> Lft:
    """Close ``i_ref = -K (y + n) + i_e`` around the plant.

    Parameters
    ----------
    plant : Lft
        Its first inputs are the commands i_ref of n axes, its first n outputs the displacements y, which do not follow
        a command at once. Of a plant with a delay the feedback comes late in it already, and i_e has yet to be delayed.
    controller : tuple of ndarray
        A, B, C, D of K, from y [m] to current [A].
    noise : bool
        Whether the loop has the sensor noise n of each axis as further inputs; it is part of the output y.

    Returns
    -------
    Lft
        Inputs ``i_e.<axis>`` and, with `noise`, ``n.<axis>``.
    """
    a_k, b_k, c_k, d_k = controller
    plant = with_late_commands(plant)
    axes = [name.removeprefix("i_ref.") for name in plant.inputs if name.startswith("i_ref.")]
    n, u, states, control = len(axes), len(plant.inputs), len(plant.A), len(a_k)
    excited = list(range(n) if plant.late is None else range(u - n, u))
    others = [k for k in range(n, u) if k not in excited]
    rest = [*others, *range(u, plant.B.shape[1])]
    b_u, b_rest = plant.B[:, :n], plant.B[:, rest]
    d_u, d_rest = plant.D[:, :n], plant.D[:, rest]
    y_x, y_rest = plant.C[:n], d_rest[:n]
    by_x = np.hstack([-d_k @ y_x, -c_k])  # i_ref over the states of plant and controller
    by_rest = -d_k @ y_rest  # and over the other inputs and the Delta ports
    A = np.zeros((states + control, states + control))
    A[:states, :states] = plant.A
    A[:states] += b_u @ by_x
    A[states:, :states] = b_k @ y_x
    A[states:, states:] = a_k
    C = np.hstack([plant.C, np.zeros((len(plant.C), control))]) + d_u @ by_x

    b_rest, d_rest = np.vstack([b_rest + b_u @ by_rest, b_k @ y_rest]), d_rest + d_u @ by_rest
    further = len(others)
    B = [np.vstack([plant.B[:, excited], np.zeros((control, n))]), b_rest[:, :further]]
    D = [plant.D[:, excited], d_rest[:, :further]]
    names = (*(f"i_e.{axis}" for axis in axes), *(plant.inputs[k] for k in others))
    if noise:
        read = d_u @ -d_k
        read[:n] += np.eye(n)
        B.append(np.vstack([b_u @ -d_k, b_k]))
        D.append(read)
        names += tuple(f"n.{axis}" for axis in axes)
    B.append(b_rest[:, further:])
    D.append(d_rest[:, further:])
    return replace(plant, A=A, B=np.hstack(B), C=C, D=np.hstack(D), inputs=names)
