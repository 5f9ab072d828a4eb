"""How forces at the magnets and displacements at the sensors reach the modal coordinates of the rotor."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

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
    """The rotor of a rig, known at magnets, sensors, supports and `places`, with `more` bending modes than it keeps.

    Where all axes lie in one plane, something else guides the rotor across it, and only that plane is modelled.

    Raises
    ------
    RigError
        What the rig file gives cannot be a free rotor, or is not known there.
    """
    own = [z for bearing in rig.bearings for z in (bearing.position, bearing.sensor_position)]
    own += [support.z for support in rig.rotor.support] + [sensor.z for sensor in rig.sensors if sensor.housing is None]
    try:
        rotor = reduced_rotor(with_more_modes(rig.rotor, more) if more else rig.rotor, [*own, *places])
    except RigError as error:
        raise RigError(f"{rig.path or rig.name}: {error}") from None
    return _in_one_plane(rotor) if rotor.planes == 2 and lies_in_one_plane(rig) else rotor


_in_one_plane = lru_cache(maxsize=16)(ReducedRotor.in_one_plane)  # the same object again, which others keep plants of


def why_unknown(rig: Rig, positions: Iterable[float], more: int = 0) -> str:
    """Why the displacement is not known at one of these positions [m], with `more` bending modes; empty if it is."""
    try:
        for z in positions:
            rotor_of(rig, more).shape(z)
    except RigError as error:
        return str(error)
    return ""


def axis_angles(rig: Rig) -> FloatArray:
    """Angle of each axis from the first bearing's zeta axis, counted from x to y, shape (axes,) [degrees]."""
    quarter = {"zeta": 0.0, "eta": 90.0}
    first = rig.bearings[0].tilt
    return np.array([bearing.tilt - first + quarter[axis] for bearing in rig.bearings for axis in bearing.axes])


def sensor_angles(rig: Rig) -> FloatArray:
    """The same of each sensor beside those of the bearings, shape (sensors,) [degrees]."""
    return np.array([sensor.direction - rig.bearings[0].tilt for sensor in rig.sensors])


def axis_directions(rig: Rig) -> FloatArray:
    """Direction of each axis in the planes of the model, shape (axes, 2).

    The rotor is the same in every plane, so the planes are laid along zeta and eta of the first bearing: where all
    bearings have one tilt and nothing turns, the two planes do not act on each other, exactly.
    """
    return _directions(axis_angles(rig))


def _directions(degrees: FloatArray) -> FloatArray:
    angles = np.deg2rad(degrees)
    return np.round(np.column_stack([np.cos(angles), np.sin(angles)]), 15)


def lies_in_one_plane(rig: Rig) -> bool:
    """Whether no axis has a part across the plane of the first one."""
    return bool(np.linalg.matrix_rank(axis_directions(rig)) == 1)


def axes_in_planes(rig: Rig, planes: int) -> FloatArray:
    """Direction of each axis in so many planes, shape (axes, planes); one plane is that of the first axis."""
    return _in_planes(rig, axis_directions(rig), planes)


def sensors_in_planes(rig: Rig, planes: int) -> FloatArray:
    """The same of each sensor beside those of the bearings; that of a plain mass reads along its axis."""
    if rig.rotor.span is None:
        return np.ones((len(rig.sensors), 1))
    return _in_planes(rig, _directions(sensor_angles(rig)), planes)


def _in_planes(rig: Rig, directions: FloatArray, planes: int) -> FloatArray:
    return directions @ axis_directions(rig)[:1].T if planes == 1 else directions


def modal_geometry(rig: Rig, rotor: ReducedRotor) -> Geometry:
    """Modal input and output matrices of all axes of a rig."""
    directions = axes_in_planes(rig, rotor.planes)
    places = [(bearing.position, bearing.sensor_position) for bearing in rig.bearings for _ in bearing.axes]
    force = [np.outer(d, rotor.shape(magnet)).ravel() for d, (magnet, _) in zip(directions, places, strict=True)]
    sensor = [np.outer(d, rotor.shape(sensor)).ravel() for d, (_, sensor) in zip(directions, places, strict=True)]
    return Geometry(force=np.array(force).T, sensor=np.array(sensor))
