"""A delay of commands that do not wait for samples, the feedback of an analog controller, and of rows of a record."""

from collections.abc import Sequence
from dataclasses import replace
from math import comb, factorial

import numpy as np

from ambid.arrays import FloatArray, StateSpace
from ambid.errors import ModelError
from ambid.loop.assembly import Lft, Port

ORDER = 6
"""Of the Pade approximant, which is exact to 1e-9 below one radian per delay."""


def with_late_commands(plant: Lft) -> Lft:
    """Let the commands ``i_ref.<axis>`` pass a Pade approximant of the plant's delay.

    What jumps, such as a held excitation, does not suit it: that enters by further inputs ``i_late.<axis>``, the last,
    which the core delays exactly. ``x' = (A x + B i_ref)/delay``, and ``C x + i_ref + i_late`` acts (D = 1 since the
    order is even).

    Parameters
    ----------
    plant : Lft
        Whose commands are its first inputs.

    Returns
    -------
    Lft
        The same where the plant has no delay.
    """
    if plant.late is None:
        return plant
    axes = [name.removeprefix("i_ref.") for name in plant.inputs if name.startswith("i_ref.")]
    m, more, n, outputs = len(axes), ORDER * len(axes), len(plant.A), len(plant.outputs)
    u, w = len(plant.inputs), len(plant.inputs) + len(plant.ports)  # where the inputs, and the linear ports, end
    z = outputs + len(plant.ports)
    a, b, c = (np.kron(np.eye(m), part) for part in pade(ORDER))
    A = np.block([[plant.A, plant.B[:, :m] @ c], [np.zeros((more, n + more))]])
    B = np.vstack([plant.B, np.zeros((more, plant.B.shape[1]))])
    B = np.hstack([B[:, :u], B[:, :m], B[:, u:w], np.eye(n + more)[:, n:], B[:, w:]])
    C = np.hstack([plant.C, plant.D[:, :m] @ c])
    C = np.vstack([C[:z], np.hstack([np.zeros((more, n)), a]), C[z:]])
    D = plant.D
    D = np.hstack([D[:, :u], D[:, :m], D[:, u:w], np.zeros((len(D), more)), D[:, w:]])
    seen = np.hstack([b, np.zeros((more, D.shape[1] - m))])
    D = np.vstack([D[:z], seen, D[z:]])
    inputs = (*plant.inputs, *(f"i_late.{axis}" for axis in axes))
    ports = (*plant.ports, *[Port(plant.late, power=-1)] * more)
    return replace(plant, A=A, B=B, C=C, D=D, inputs=inputs, ports=ports)


def pade(order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A, b, c of the Pade approximant of ``exp(-s) - 1`` of an even order, in balanced companion form.

    Returns
    -------
    A : ndarray, shape (order, order)
    b : ndarray, shape (order, 1)
    c : ndarray, shape (1, order)
    """
    q = [factorial(2 * order - k) * comb(order, k) / factorial(2 * order) for k in range(order + 1)]
    # rows of the companion form, each state scaled so that neighbours couple with like strength
    ratio = [q[k] / q[k + 1] for k in range(order)]
    a = np.zeros((order, order))
    for k in range(order - 1):
        a[k, k + 1] = ratio[k]
    a[order - 1, :] = -ratio[order - 1]
    b = np.zeros((order, 1))
    b[order - 1] = ratio[order - 1]
    c = np.array([[-2.0 if k % 2 else 0.0 for k in range(order)]])
    return a, b, c


def with_late_rows(matrices: StateSpace, shifts: Sequence[int]) -> StateSpace:
    """A, B, C, D in samples with each output late by whole samples, which become states.

    Raises
    ------
    ModelError
        If an output is early.
    """
    if min(shifts, default=0) < 0:
        raise ModelError("an output that is recorded early by a sample and more has no state space")
    A, B, C, D = matrices
    for output, late in enumerate(shifts):
        for _ in range(late):  # a state that is what the output was a sample before
            A = np.block([[A, np.zeros((len(A), 1))], [C[[output]], np.zeros((1, 1))]])
            B, C, D = np.vstack([B, D[[output]]]), np.hstack([C, np.zeros((len(C), 1))]), D.copy()
            C[output], D[output] = np.eye(len(A))[-1], 0.0
    return A, B, C, D
