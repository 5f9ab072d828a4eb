"""The analog controller, folded into the LFT of the plant."""

from __future__ import annotations

import numpy as np

from ambid.loop.assembly import FloatArray, Lft


def close_analog(plant: Lft, controller: tuple[FloatArray, FloatArray, FloatArray, FloatArray], *, noise: bool) -> Lft:
    """Close ``i_ref = -K (y + n) + i_e`` around the plant.

    Parameters
    ----------
    plant : Lft
        Its first inputs are the commands i_ref of n axes, its first n outputs the displacements y, which do not follow
        a command at once.
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
    commands = [name for name in plant.inputs if name.startswith("i_ref.")]
    n, states, control, others = len(commands), len(plant.A), len(a_k), len(plant.inputs) - len(commands)
    b_u, b_rest = plant.B[:, :n], plant.B[:, n:]
    d_u, d_rest = plant.D[:, :n], plant.D[:, n:]
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
    B, D = [np.vstack([b_u, np.zeros((control, n))]), b_rest[:, :others]], [d_u, d_rest[:, :others]]
    names = tuple(name.replace("i_ref.", "i_e.") for name in plant.inputs)
    if noise:
        read = d_u @ -d_k
        read[:n] += np.eye(n)
        B.append(np.vstack([b_u @ -d_k, b_k]))
        D.append(read)
        names += tuple(name.replace("i_ref.", "n.") for name in commands)
    B.append(b_rest[:, others:])
    D.append(d_rest[:, others:])
    return Lft(A, np.hstack(B), C, np.hstack(D), names, plant.outputs, plant.ports, plant.blocks)
