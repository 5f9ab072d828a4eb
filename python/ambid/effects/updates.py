"""Rigs with other values of some keys, such as a heavier rotor: what errors of known values make of a rig file."""

from typing import Any, TypeVar, cast

import numpy as np
from scipy.interpolate import CubicSpline

from ambid.arrays import FloatArray
from ambid.loop.geometry import rotor_of
from ambid.rig import MatrixRotor, ModalRotor, PidController, PointMassRotor, Rig, StateSpaceController
from ambid.rig.fields import Spec
from ambid.rig.rotor import SAME_PLACE

Table = TypeVar("Table", bound=Spec)


def with_bearing(rig: Rig, name: str, key: str, by: float) -> Rig:
    """The rig with a place of one bearing moved [m]; a rotor given by its modes gets their shapes there."""
    rotor, bearings = rig.rotor, list(rig.bearings)
    k = [own.name for own in bearings].index(name)
    z = getattr(bearings[k], key) + by
    if isinstance(rotor, ModalRotor) and np.abs(z - np.array(rotor.positions)).min() > SAME_PLACE:
        shape = CubicSpline(rotor.positions, np.array(rotor.shapes).T)(z).tolist()
        at = int(np.searchsorted(rotor.positions, z))
        rotor = _with(
            rotor,
            positions=(*rotor.positions[:at], z, *rotor.positions[at:]),
            shapes=tuple((*row[:at], x, *row[at:]) for row, x in zip(rotor.shapes, shape, strict=True)),
        )
    bearings[k] = _with(bearings[k], **{key: z})
    return rig.replace(rotor=rotor, bearings=tuple(bearings))


def with_inertia(rig: Rig, motion: str, error: float) -> Rig | None:
    """The rig whose rotor has more inertia against a rigid motion, by a relative error; None where no key holds that.

    Bending modes and, in modal coordinates, gyroscopic moments stay as they are.

    Parameters
    ----------
    motion : {"mass", "inertia"}
        Translation, or rotation about the centre of mass.
    """
    rotor = rig.rotor
    if isinstance(rotor, PointMassRotor):
        return rig.replace(rotor=_with(rotor, mass=(1.0 + error) * rotor.mass)) if motion == "mass" else None
    reduced = rotor_of(rig)
    u = reduced.rigid_motions()[motion]
    if isinstance(rotor, ModalRotor):
        shapes = np.array(rotor.shapes)
        shapes[:2] += ((1.0 + error) ** -0.5 - 1.0) * np.outer(u, u @ shapes[:2])
        return rig.replace(rotor=_with(rotor, shapes=_rows(shapes)))
    if not isinstance(rotor, MatrixRotor):
        return None
    matrix = np.eye(4 * len(rotor.node_positions))
    n = len(reduced.frequencies_rad_s)
    for plane in range(reduced.planes):
        own = [plane * n, plane * n + 1]
        matrix += ((1.0 + error) ** 0.5 - 1.0) * np.outer(reduced.T_R[:, own] @ u, u @ reduced.T_L[own])
    turned = {
        key: _rows(matrix.T @ np.array(getattr(rotor, key)) @ matrix) for key in ("M", "G") if getattr(rotor, key)
    }
    return rig.replace(rotor=_with(rotor, **turned))


def with_frequency(rig: Rig, mode: int, error: float) -> Rig:
    """The rig whose kept bending mode, from 1 on, has 1 + 2 `error` times the stiffness, and as much damping force."""
    factor, rotor, reduced = (1.0 + 2.0 * error) ** 0.5, rig.rotor, rotor_of(rig)
    if isinstance(rotor, ModalRotor):
        hz, key = list(rotor.frequencies_hz), "frequencies_hz"
        k = len(hz) - rotor.listed_bending_modes + mode - 1
    else:
        first, kept = reduced.rigid_modes, rotor.bending_modes
        hz = (reduced.frequencies_rad_s[first : first + kept] / (2.0 * np.pi)).tolist()
        hz, key, k = (
            [*hz, *(getattr(rotor, "bending_frequencies_hz", None) or ())[kept:]],
            "bending_frequencies_hz",
            mode - 1,
        )
    hz[k] *= factor
    return with_damping(rig.replace(rotor=_with(rotor, **{key: tuple(hz)})), mode, 1.0 / factor - 1.0)


def with_damping(rig: Rig, mode: int, error: float) -> Rig:
    """The rig whose kept bending mode, from 1 on, has 1 + `error` times the damping ratio."""
    rotor = rig.rotor
    if isinstance(rotor, ModalRotor):
        ratios, key, k = list(rotor.damping), "damping", len(rotor.damping) - rotor.listed_bending_modes + mode - 1
    else:
        given = cast(Any, rotor).modal_damping
        ratios, key, k = (
            [given] * rotor.bending_modes if isinstance(given, float) else list(given),
            "modal_damping",
            mode - 1,
        )
    ratios[k] *= 1.0 + error
    return rig.replace(rotor=_with(rotor, **{key: tuple(ratios)}))


def with_slower(rig: Rig, error: float) -> Rig:
    """The rig with 1 + `error` times the amplifiers' time constant."""
    amplifier = rig.amplifier
    return rig.replace(amplifier=_with(amplifier, time_constant=(1.0 + error) * amplifier.time_constant))


def with_controller_gain(rig: Rig, gain: str, error: float) -> Rig:
    """The rig with 1 + `error` times a gain of its controller, or, as ``gain``, all of it."""
    own, factor = rig.controller, 1.0 + error
    if isinstance(own, PidController):
        keys = [gain]
    else:
        keys = ["C", "D"] if isinstance(own, StateSpaceController) else ["numerator"]
    return rig.replace(controller=_with(own, **{key: _times(getattr(own, key), factor) for key in keys}))


def _with(table: Table, **changes: Any) -> Table:
    """A table with other values, checked as a new one."""
    return type(table)(**{key: getattr(table, key) for key in type(table).model_fields} | changes)


def _times(value: Any, factor: float) -> Any:
    """A number or nested tuples of them, times a factor."""
    return tuple(_times(own, factor) for own in value) if isinstance(value, tuple) else factor * value


def _rows(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))
