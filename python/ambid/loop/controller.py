"""The analog controller, folded into the LFT of the plant."""

from __future__ import annotations

import numpy as np

from ambid.loop.assembly import FloatArray, Lft


def close_analog(plant: Lft, controller: tuple[FloatArray, FloatArray, FloatArray, FloatArray], *, noise: bool) -> Lft:
    """Close ``i_ref = -K (y + n) + i_e`` around the plant.

    Parameters
    ----------
    plant : Lft
        Its inputs are the commands i_ref of n axes, its first n outputs the displacements y, which do not follow a
        command at once.
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
    n, states, control = len(plant.inputs), len(plant.A), len(a_k)
    b_u, b_w = plant.B[:, :n], plant.B[:, n:]
    d_u, d_w = plant.D[:, :n], plant.D[:, n:]
    y = plant.C[:n]
    command = np.hstack([-d_k @ y, -c_k])  # i_ref over the states of plant and controller
    A = np.zeros((states + control, states + control))
    A[:states, :states] = plant.A
    A[:states] += b_u @ command
    A[states:, :states] = b_k @ y
    A[states:, states:] = a_k
    C = np.hstack([plant.C, np.zeros((len(plant.C), control))]) + d_u @ command

    excitation = np.vstack([b_u, np.zeros((control, n))])
    B, D = [excitation], [d_u]
    names = tuple(name.replace("i_ref.", "i_e.") for name in plant.inputs)
    if noise:
        read = d_u @ -d_k
        read[:n] += np.eye(n)
        B.append(np.vstack([b_u @ -d_k, b_k]))
        D.append(read)
        names += tuple(name.replace("i_ref.", "n.") for name in plant.inputs)
    B.append(np.vstack([b_w, np.zeros((control, b_w.shape[1]))]))
    D.append(d_w)
    return Lft(A, np.hstack(B), C, np.hstack(D), names, plant.outputs, plant.ports)
