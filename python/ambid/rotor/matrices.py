"""A rotor given as M, G, K matrices, held against what the reduction relies on: two equal planes, G skew-symmetric."""

from __future__ import annotations

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import RigError
from ambid.rig import MatrixRotor
from ambid.rotor.assembly import BeamModel
from ambid.rotor.beam import PlaneMatrices, plane_bases, plane_freedoms

_EQUAL = 1e-9  # of the largest entry of the matrix


def matrix_model(rotor: MatrixRotor) -> BeamModel:
    """Beam model from the matrices of a rig.

    Parameters
    ----------
    rotor : MatrixRotor
        M and K, optionally G, of shape (4 n, 4 n) with the freedoms [u_x, u_y, theta_x, theta_y] of each of the n
        `node_positions`.

    Returns
    -------
    BeamModel
        M and K of plane x, for both; G as given, zero if there is none.

    Raises
    ------
    RigError
        M or K differ between the planes or couple them, or G is not skew-symmetric, by more than 1e-9 of the largest
        entry.
    """
    M, K = np.array(rotor.M), np.array(rotor.K)
    G = np.zeros_like(M) if rotor.G is None else np.array(rotor.G)
    _check_planes("M", M)
    _check_planes("K", K)
    excess = _largest(G + G.T)
    if excess > _EQUAL * _largest(G):
        raise RigError(
            f"rotor.G is not skew-symmetric: G + G^T reaches {excess:g}, allowed is {_EQUAL:g} of the largest entry "
            f"of G, {_largest(G):g}. G holds the gyroscopic moments per rad/s only; leave damping out of it."
        )
    (x, _), (y, signs) = plane_freedoms(len(M) // 4)
    here = np.ix_(x, x)
    return BeamModel(np.array(rotor.node_positions), PlaneMatrices(M[here], K[here], G[np.ix_(x, y)] * signs), G)


def _check_planes(name: str, matrix: FloatArray) -> None:
    x, y = plane_bases(len(matrix) // 4)
    for fault, excess in (
        ("differs between plane x and plane y", _largest(x.T @ matrix @ x - y.T @ matrix @ y)),
        ("couples plane x with plane y", _largest(x.T @ matrix @ y)),
    ):
        if excess > _EQUAL * _largest(matrix):
            raise RigError(
                f"rotor.{name} {fault} by {excess:g}; allowed is {_EQUAL:g} of its largest entry, "
                f"{_largest(matrix):g}. The rotor must be the same in both planes, with freedoms [u_x, u_y, theta_x, "
                "theta_y] a node and theta right-handed about its axis (theta_y = du_x/dz, theta_x = -du_y/dz)."
            )


def _largest(matrix: FloatArray) -> float:
    return float(np.max(np.abs(matrix)))
