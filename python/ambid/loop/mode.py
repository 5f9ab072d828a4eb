"""Which mode of a rotor a pole of the closed loop moves."""

from __future__ import annotations

import numpy as np

from ambid.arrays import FloatArray
from ambid.rotor import ReducedRotor

__all__ = ["moved_by_worst"]


def moved_by_worst(sampled: FloatArray, rotor: ReducedRotor) -> str:
    """The mode of the rotor that the pole which grows fastest moves most, by its eigenvector.

    Parameters
    ----------
    sampled : ndarray, shape (states, states)
        A of the loop over one sample; its first states are the modal coordinates, mass-normalised.
    rotor : ReducedRotor
        With all modes of the loop.
    """
    values, vectors = np.linalg.eig(sampled)
    moved = np.abs(vectors[:, np.argmax(np.abs(values))])
    modes = len(rotor.frequencies_rad_s)
    mode = int(np.argmax(np.linalg.norm(moved[: modes * rotor.planes].reshape(rotor.planes, modes), axis=0)))
    if mode < rotor.rigid_modes:
        return "it moves the rotor as a rigid body"
    own = rotor.frequencies_rad_s[mode] / (2.0 * np.pi)
    return f"of the rotor it moves bending mode {mode - rotor.rigid_modes + 1} most, {own:.4g} Hz at rest"
