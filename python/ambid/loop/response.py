"""Frequency response of a state space."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur
from scipy.linalg.lapack import dgebal

from ambid.arrays import ComplexArray, StateSpace


def frequency_response(system: StateSpace, points: NDArray[Any]) -> ComplexArray:
    """``C (p I - A)^-1 B + D`` at each point p = j w, or p = exp(j w dt) of a sampled system.

    The Schur form of A, its states scaled to like size, makes each state one division, whatever its poles are.

    Returns
    -------
    ndarray, shape (points, outputs, inputs)
    """
    A, B, C, D = system
    scale = np.ones(len(A))
    T = Z = A
    if A.size:
        balanced, _, _, scale, _ = dgebal(A, scale=True, permute=False)
        T, Z = schur(balanced, output="complex")
    drive = Z.conj().T @ (B / scale[:, None])
    x = np.zeros((len(A), B.shape[1], len(points)), dtype=complex)
    for j in reversed(range(len(A))):
        fed = np.tensordot(T[j, j + 1 :], x[j + 1 :], axes=1)
        x[j] = (drive[j][:, None] + fed) / (points - T[j, j])
    return np.asarray(np.moveaxis(np.tensordot((C * scale) @ Z, x, axes=1), -1, 0) + D, dtype=np.complex128)
