"""Eigenmodes of a closed loop: poles, what they move, and how parameters move them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig, matrix_balance

from ambid.arrays import ComplexArray, FloatArray
from ambid.rotor import ReducedRotor

TWINS = 1e-6
"""Relative distance of two poles below which each by itself has no derivative."""


@dataclass(frozen=True)
class Modes:
    """Poles with what they move.

    Attributes
    ----------
    poles : ndarray of complex, shape (n,)
        [1/s], slowest first.
    shapes : ndarray of complex, shape (outputs, n)
        Outputs that each pole moves.
    slopes : ndarray of complex, shape (n, free)
        Exact derivatives of the poles by parameters; NaN of poles that coincide.
    """

    poles: ComplexArray
    shapes: ComplexArray
    slopes: ComplexArray

    @property
    def has_twin(self) -> NDArray[np.bool_]:
        """Which poles coincide with another: their shapes are any mixture of both, shape (n,)."""
        return _has_twin(self.poles)


def eigenmodes(A: FloatArray, C: FloatArray, slopes: FloatArray, sample_time: float = 0.0) -> Modes:
    """Eigenmodes of a system whose A has these derivatives by parameters.

    With left and right vectors l and r the derivative of an eigenvalue is ``l* dA r / l* r``; a sampled system's poles
    are ``ln(mu) / dt`` of its eigenvalues mu.

    Parameters
    ----------
    A : ndarray, shape (n, n)
    C : ndarray, shape (outputs, n)
    slopes : ndarray, shape (free, n, n)
    sample_time : float
        Of a sampled system [s]; 0 of a continuous one.
    """
    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    values, left, right = eig(balanced, left=True)
    moved = np.einsum("sk,psr,rk->kp", left.conj(), slopes * (scale / scale[:, None]), right)
    moved /= np.einsum("sk,sk->k", left.conj(), right)[:, None]
    moved[_has_twin(values)] = np.nan
    poles = values.astype(complex)
    if sample_time:
        with np.errstate(divide="ignore"):  # a command under way has its pole at 0
            poles = np.log(poles) / sample_time
        moved = moved / (values[:, None] * sample_time)
    order = np.lexsort((poles.imag, -poles.real))
    return Modes(poles[order], (C * scale) @ right[:, order], moved[order])


def _has_twin(poles: ComplexArray) -> NDArray[np.bool_]:
    known = np.where(np.isfinite(poles), poles, np.inf)
    with np.errstate(invalid="ignore"):
        apart = np.abs(known[:, None] - known) + np.diag(np.full(len(poles), np.inf))
        return np.asarray(np.nanmin(apart, axis=1, initial=np.inf) < TWINS * np.abs(known))


def worst_mode(sampled: FloatArray, rotor: ReducedRotor) -> tuple[int, float]:
    """The mode of the rotor that the pole which grows fastest moves most, by its eigenvector.

    Parameters
    ----------
    sampled : ndarray, shape (states, states)
        A of the loop over one sample; its first states are the modal coordinates, mass-normalised.
    rotor : ReducedRotor
        With all modes of the loop.

    Returns
    -------
    number : int
        Of the bending mode, counted from 1; 0 of a rotor that moves as a rigid body.
    frequency_hz : float
        At rest.
    """
    values, vectors = np.linalg.eig(sampled)
    moved = np.abs(vectors[:, np.argmax(np.abs(values))])
    modes = len(rotor.frequencies_rad_s)
    mode = int(np.argmax(np.linalg.norm(moved[: modes * rotor.planes].reshape(rotor.planes, modes), axis=0)))
    return max(0, mode - rotor.rigid_modes + 1), float(rotor.frequencies_rad_s[mode]) / (2.0 * np.pi)


def moved_by_worst(sampled: FloatArray, rotor: ReducedRotor) -> str:
    """The same in words."""
    number, frequency_hz = worst_mode(sampled, rotor)
    if not number:
        return "it moves the rotor as a rigid body"
    return f"of the rotor it moves bending mode {number} most, {frequency_hz:.4g} Hz at rest"
