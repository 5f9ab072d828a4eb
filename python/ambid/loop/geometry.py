"""How forces at the magnets and displacements at the sensors reach the modal coordinates of the rotor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import RigError
from ambid.rig import Rig
from ambid.rotor import ReducedRotor, reduced_rotor, with_more_modes


@dataclass(frozen=True)
class Geometry:
    """Modal input and output matrices of all axes.

    Attributes
    ----------
    force : ndarray, shape (modal coordinates, axes)
        Modal force of a unit force of each axis; its transpose gives the displacement s at each magnet.
    sensor : ndarray, shape (axes, modal coordinates)
        Displacement y at each sensor.
    """

    force: FloatArray
    sensor: FloatArray


def rotor_of(rig: Rig, more: int = 0, places: Iterable[float] = ()) -> ReducedRotor:
    """The rotor of a rig, known at its magnets, sensors and `places`, with `more` bending modes than its model keeps.

    Raises
    ------
    RigError
        What the rig file gives cannot be a free rotor, or is not known there.
    """
    own = [z for bearing in rig.bearings for z in (bearing.position, bearing.sensor_position)]
    try:
        return reduced_rotor(with_more_modes(rig.rotor, more) if more else rig.rotor, [*own, *places])
    except RigError as error:
        raise RigError(f"{rig.path or rig.name}: {error}") from None


def why_unknown(rig: Rig, positions: Iterable[float]) -> str:
    """Why the rotor's displacement is not known at one of these positions [m]; empty where it is at all."""
    try:
        for z in positions:
            rotor_of(rig).shape(z)
    except RigError as error:
        return str(error)
    return ""


def axis_angles(rig: Rig) -> FloatArray:
    """Angle of each axis from the first bearing's zeta axis, counted from x to y, shape (axes,) [degrees]."""
    quarter = {"zeta": 0.0, "eta": 90.0}
    first = rig.bearings[0].tilt
    return np.array([bearing.tilt - first + quarter[axis] for bearing in rig.bearings for axis in bearing.axes])


def axis_directions(rig: Rig) -> FloatArray:
    """Direction of each axis in the planes of the model, shape (axes, 2).

    The rotor is the same in every plane, so the planes are laid along zeta and eta of the first bearing: where all
    bearings have one tilt and nothing turns, the two planes do not act on each other, exactly.
    """
    angles = np.deg2rad(axis_angles(rig))
    return np.round(np.column_stack([np.cos(angles), np.sin(angles)]), 15)


def modal_geometry(rig: Rig, rotor: ReducedRotor) -> Geometry:
    """Modal input and output matrices of all axes of a rig."""
    directions = axis_directions(rig)[:, : rotor.planes]
    places = [(bearing.position, bearing.sensor_position) for bearing in rig.bearings for _ in bearing.axes]
    force = [np.kron(d, rotor.shape(magnet)) for d, (magnet, _) in zip(directions, places, strict=True)]
    sensor = [np.kron(d, rotor.shape(sensor)) for d, (_, sensor) in zip(directions, places, strict=True)]
    return Geometry(force=np.array(force).T, sensor=np.array(sensor))
