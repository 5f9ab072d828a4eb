"""The plant as an upper linear fractional transformation: everything known in G, K_i, K_s and tau_e in Delta."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambid.rig import Rig
from ambid.rotor import ReducedRotor

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Port:
    """One diagonal entry of Delta: ``w = scale * value**power * z``.

    Attributes
    ----------
    slot : str
        What the entry stands for, such as ``K_i.A_zeta``; a parameter fills one slot or several.
    power : int
        1 for K_i and K_s, -1 for a time constant.
    scale : float
        Constant factor.
    """

    slot: str
    power: int = 1
    scale: float = 1.0


@dataclass(frozen=True)
class Lft:
    """G with its Delta ports: ``x' = A x + B [u; w]``, ``[y; z] = C x + D [u; w]``, ``w = Delta z`` (eq. 8, Fig. 3).

    Attributes
    ----------
    A : ndarray, shape (n, n)
    B : ndarray, shape (n, inputs + ports)
    C : ndarray, shape (outputs + ports, n)
    D : ndarray, shape (outputs + ports, inputs + ports)
    inputs, outputs : tuple of str
        Names of the signals u and y, such as ``i_ref.A_zeta`` and ``y.A_zeta``.
    ports : tuple of Port
        Entries of Delta, in the order of w and z.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    ports: tuple[Port, ...]


@dataclass(frozen=True)
class Geometry:
    """How forces at the magnets and displacements reach the modal coordinates of the rotor.

    Attributes
    ----------
    force : ndarray, shape (modal coordinates, axes)
        Modal force of a unit force of each axis; its transpose gives the displacement s at each magnet.
    sensor : ndarray, shape (axes, modal coordinates)
        Displacement y at each sensor.
    """

    force: FloatArray
    sensor: FloatArray


def axis_angles(rig: Rig) -> list[float]:
    """Angle of each axis from the first bearing's zeta axis, counted from x to y [degrees]."""
    quarter = {"zeta": 0.0, "eta": 90.0}
    first = rig.bearings[0].tilt
    return [bearing.tilt - first + quarter[axis] for bearing in rig.bearings for axis in bearing.axes]


def geometry(rig: Rig, rotor: ReducedRotor) -> Geometry:
    """Modal input and output matrices of all axes.

    The rotor is the same in every plane, so its planes are laid along zeta and eta of the first bearing: where all
    bearings have one tilt and nothing turns, the two planes do not act on each other, exactly.
    """
    angles = iter(axis_angles(rig))
    force, sensor = [], []
    for bearing in rig.bearings:
        for _ in bearing.axes:
            angle = np.deg2rad(next(angles))
            directions = np.round([np.cos(angle), np.sin(angle)], 15)[: rotor.planes]
            force.append(np.kron(directions, rotor.shape(bearing.position)))
            sensor.append(np.kron(directions, rotor.shape(bearing.sensor_position)))
    return Geometry(force=np.array(force).T, sensor=np.array(sensor))


def plant(rig: Rig, rotor: ReducedRotor) -> Lft:
    """Rotor, amplifiers and actuators between the commands i_ref and the outputs y, i_c.

    States: modal coordinates, their rates, current i_a behind each amplifier (none where it is ideal), force current
    i_f behind each actuator. ``tau_a i_a' = i_ref - i_a``, ``tau_e i_f' = i_a - i_f``, ``f = K_i i_f + K_s s``;
    ``i_c = i_a``. K_i, K_s and 1/tau_e are the entries of Delta (B_Delta, C_Delta of eqs. 4-7).

    Parameters
    ----------
    rig : Rig
    rotor : ReducedRotor
        Of the same rig, known at its bearings and sensors.

    Returns
    -------
    Lft
        Inputs ``i_ref.<axis>``, outputs ``y.<axis>`` then ``i_c.<axis>``, ports K_i, K_s, tau_e of each axis.
    """
    where = geometry(rig, rotor)
    m, n = where.force.shape
    ideal = rig.amplifier.time_constant == 0.0
    modes, rates = slice(0, m), slice(m, 2 * m)
    n_a = 0 if ideal else n
    amplifier, actuator = slice(2 * m, 2 * m + n_a), slice(2 * m + n_a, 2 * m + n_a + n)
    states = actuator.stop
    k_i, k_s, tau = slice(n, 2 * n), slice(2 * n, 3 * n), slice(3 * n, 4 * n)  # columns of B, after i_ref

    A, B = np.zeros((states, states)), np.zeros((states, 4 * n))
    omega = np.tile(rotor.frequencies_rad_s, rotor.planes)
    zeta = np.tile(rotor.damping, rotor.planes)
    A[modes, rates] = np.eye(m)
    A[rates, modes] = -np.diag(omega**2)
    A[rates, rates] = -np.diag(2.0 * zeta * omega) - rig.speed * rotor.gyroscopic
    B[rates, k_i] = B[rates, k_s] = where.force
    B[actuator, tau] = np.eye(n)

    # rows of C and D: y, i_c, then z of K_i (i_f), of K_s (s), of tau_e (i_a - i_f)
    C, D = np.zeros((5 * n, states)), np.zeros((5 * n, 4 * n))
    C[0:n, modes] = where.sensor
    C[2 * n : 3 * n, actuator] = np.eye(n)
    C[3 * n : 4 * n, modes] = where.force.T
    C[4 * n :, actuator] = -np.eye(n)
    if ideal:
        D[n : 2 * n, :n] = D[4 * n :, :n] = np.eye(n)
    else:
        A[amplifier, amplifier] = -np.eye(n) / rig.amplifier.time_constant
        B[amplifier, :n] = np.eye(n) / rig.amplifier.time_constant
        C[n : 2 * n, amplifier] = C[4 * n :, amplifier] = np.eye(n)
    ports = [
        *(Port(f"K_i.{axis}") for axis in rig.axes),
        *(Port(f"K_s.{axis}") for axis in rig.axes),
        *(Port(f"tau_e.{axis}", power=-1) for axis in rig.axes),
    ]
    return Lft(A, B, C, D, _names("i_ref", rig.axes), _names("y", rig.axes) + _names("i_c", rig.axes), tuple(ports))


def _names(signal: str, axes: Iterable[str]) -> tuple[str, ...]:
    return tuple(f"{signal}.{axis}" for axis in axes)
