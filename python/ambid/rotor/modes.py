"""The rotor's own modes, free and at rest: the second-order modal model that the plant is built on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh

from ambid.arrays import FloatArray
from ambid.errors import RigError
from ambid.rig import FiniteElementRotor, MatrixRotor, ModalRotor, PointMassRotor
from ambid.rig.rotor import SAME_PLACE
from ambid.rotor.assembly import BeamModel, assemble, lowest_modes, matrix_model, place_of
from ambid.rotor.beam import plane_freedoms

_FREE = 1e-3  # a rigid frequency above this part of the first bending frequency means a rotor that is held
_SAME_MODE = 2.0  # a measured frequency farther than this factor from the computed one is a mistake of units


@dataclass(frozen=True, eq=False)
class ReducedRotor:
    """Rotor in mass-normalised modal coordinates eta, the n modes of plane x before the same n modes of plane y.

    eta'' + (mass_damping + diag(2 damping frequencies)) eta' + coupling(speed) eta' + diag(frequencies^2) eta =
    T_R^T f, speed in rad/s, f the forces on the full freedoms q = T_R eta, those of supports among them. Rigid modes
    come first, their frequency is exactly zero.

    Attributes
    ----------
    frequencies_rad_s : ndarray, shape (n,)
        Natural frequencies at rest [rad/s], the same in each plane.
    damping : ndarray, shape (n,)
        Damping ratios [-].
    gyroscopic : ndarray, shape (planes n, planes n)
        Skew-symmetric gyroscopic matrix per rad/s of speed.
    T_R : ndarray, shape (freedoms, planes n)
        Right matrix, from modal coordinates to the full freedoms.
    T_L : ndarray, shape (planes n, freedoms)
        Left matrix T_R^T M, with T_L T_R = I. A rotor given by modes or as a mass has no other freedoms than its
        modal coordinates and its displacement; then both matrices are diagonal.
    positions : ndarray, shape (m,)
        Axial positions at which the modes are known [m]; empty for a point mass, which is the same everywhere.
    shapes : ndarray, shape (m, n), or (1, 1) for a point mass
        Lateral displacement of each mode in its plane [1/sqrt(kg)].
    between : bool
        Whether the positions lie so close that a cubic spline through the shapes holds between them: always those of
        finite elements; else three of ten of a half-wave of the highest bending mode, or closer.
    planes : int
        2, or 1 for a point mass on one axis and for a rotor that is looked at in one plane.
    mass_damping : float
        Viscous damping to ground over mass [1/s], the same of every mode, of the rigid ones too.
    further_damping : ndarray, shape (planes n, planes n), or a scalar zero
        Damping matrix beside these [1/s], of a rotor whose matrices hold one.
    """

    frequencies_rad_s: FloatArray
    damping: FloatArray
    gyroscopic: FloatArray
    T_R: FloatArray
    T_L: FloatArray
    positions: FloatArray
    shapes: FloatArray
    between: bool = False
    planes: int = 2
    mass_damping: float = 0.0
    further_damping: FloatArray | float = 0.0

    def coupling(self, speed: float) -> FloatArray:
        """Damping that couples the modes at a speed [rad/s]: gyroscopic and `further_damping`, [1/s]."""
        return speed * self.gyroscopic + self.further_damping

    @property
    def rigid_modes(self) -> int:
        """Modes of zero frequency in each plane; they come first."""
        return int(np.count_nonzero(self.frequencies_rad_s == 0.0))

    def rigid_motions(self) -> dict[str, FloatArray]:
        """Translation, and rotation about the centre of mass, as combinations of the two rigid modes of a plane.

        Returns
        -------
        dict of str to ndarray, shape (2,)
            By what resists, ``mass`` and ``inertia``. Orthogonal, of unit length: rigid modes that are given may be any
            orthogonal mixture of the two.
        """
        slopes = np.polynomial.polynomial.polyfit(self.positions, self.shapes[:, :2], 1)[1]
        rotation = slopes / np.linalg.norm(slopes)
        rotation[np.abs(rotation) < 1e-12] = 0.0
        return {"mass": np.array([rotation[1], -rotation[0]]), "inertia": rotation}

    def in_one_plane(self) -> ReducedRotor:
        """The same rotor where something else guides it across one plane, and holds its gyroscopic moments."""
        n = len(self.frequencies_rad_s)
        still, further = np.zeros((n, n)), self.coupling(0.0)[:n, :n]
        one = replace(self, gyroscopic=still, further_damping=further, planes=1)
        return replace(one, T_R=self.T_R[:, :n], T_L=self.T_L[:n])

    def shape(self, z: float) -> FloatArray:
        """Lateral displacement of each mode at an axial position, identical for both planes.

        Parameters
        ----------
        z : float
            Axial position [m].

        Returns
        -------
        ndarray, shape (n,)
            Mass-normalised [1/sqrt(kg)].

        Raises
        ------
        RigError
            `z` is off the shaft, or, unless the modes are known between the positions, not within 1e-6 m of one; the
            message says what is near.
        """
        if not self.positions.size:
            return self.shapes[0].copy()
        if not self.between:
            return self.shapes[place_of(z, self.positions)].copy()
        first, last = self.positions[0], self.positions[-1]
        if not first - SAME_PLACE <= z <= last + SAME_PLACE:
            raise RigError(f"position {z:g} m is off the shaft, which reaches from {first:g} to {last:g} m")
        return self._spline(z)

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(self.positions, self.shapes)


def further_modes(rotor: FiniteElementRotor | MatrixRotor | ModalRotor | PointMassRotor, most: int) -> int:
    """How many bending modes a plane the rotor's data hold beyond those that its model keeps, up to `most`.

    A shaft of sections always has more; matrices have as many as they have freedoms, modes are those of the list.
    """
    match rotor:
        case FiniteElementRotor():
            return most
        case MatrixRotor():
            held = 2 * len(rotor.node_positions) - 2
        case ModalRotor():
            held = rotor.listed_bending_modes
        case PointMassRotor():
            held = 0
    return min(most, held - rotor.bending_modes)


def with_more_modes(
    rotor: FiniteElementRotor | MatrixRotor | ModalRotor | PointMassRotor, more: int
) -> FiniteElementRotor | MatrixRotor | ModalRotor:
    """Return the same rotor with further bending modes in each plane, undamped but for those of a list.

    Raises
    ------
    RigError
        The rotor's data do not hold so many.
    """
    if isinstance(rotor, PointMassRotor) or further_modes(rotor, more) < more:
        raise RigError(f"rotor.kind = {rotor.kind!r}: the rotor has no {more} bending modes beyond those of its model")
    kept = rotor.bending_modes
    if isinstance(rotor, ModalRotor):
        return rotor.model_copy(update={"flexible_modes": kept + more})
    given = rotor.modal_damping
    damping = [given] * kept if isinstance(given, float) else list(given[:kept])
    return rotor.model_copy(update={"flexible_modes": kept + more, "modal_damping": (*damping, *[0.0] * more)})


def reduced_rotor(
    rotor: FiniteElementRotor | MatrixRotor | ModalRotor | PointMassRotor, nodes_at: Sequence[float]
) -> ReducedRotor:
    """Modal model of the rotor of a rig, whichever way the rig gives it.

    Parameters
    ----------
    rotor : FiniteElementRotor, MatrixRotor, ModalRotor or PointMassRotor
        The rig's rotor.
    nodes_at : sequence of float
        Positions whose shape will be asked for, such as bearings and sensors [m].

    Returns
    -------
    ReducedRotor
        One plane for a point mass, else two.

    Raises
    ------
    RigError
        What is given cannot be a free rotor, or is not known at one of `nodes_at`.
    """
    return _reduced(rotor, tuple(float(z) for z in nodes_at))


@lru_cache(maxsize=64)
def _reduced(
    rotor: FiniteElementRotor | MatrixRotor | ModalRotor | PointMassRotor, nodes_at: tuple[float, ...]
) -> ReducedRotor:
    match rotor:
        case FiniteElementRotor() | MatrixRotor():
            model = assemble(rotor, nodes_at) if isinstance(rotor, FiniteElementRotor) else matrix_model(rotor)
            reduced = reduce(model, rotor.flexible_modes, rotor.modal_damping, rotor.bending_frequencies_hz)
            if isinstance(rotor, MatrixRotor):
                further = reduced.T_R.T @ np.array(rotor.C) @ reduced.T_R if rotor.C else 0.0
                close = _lie_close(rotor.node_positions, rotor.flexible_modes)
                reduced = replace(reduced, between=close, further_damping=further)
        case ModalRotor():
            reduced = _given_modes(rotor)
        case PointMassRotor():
            reduced = _point_mass(rotor.mass)
    if reduced.planes == 2:
        for z in nodes_at:
            place_of(z, reduced.positions)
    return replace(reduced, mass_damping=rotor.mass_damping) if rotor.mass_damping else reduced


def _lie_close(positions: Sequence[float], bending_modes: int) -> bool:
    """Whether a cubic spline through the shapes at these positions holds between them.

    The half-waves of free-free bending mode k are about ``1/(k + 1/2)`` of the shaft long; rigid modes are straight.
    """
    gaps = np.diff(positions)
    # part of a half-wave of a bending mode between positions: a cubic spline then errs by some 2 %
    return bending_modes == 0 or bool(gaps.max() * (bending_modes + 0.5) <= 0.3 * gaps.sum())


def reduce(
    model: BeamModel,
    flexible_modes: int,
    modal_damping: float | Sequence[float] = 0.0,
    bending_frequencies_hz: Sequence[float] | None = None,
) -> ReducedRotor:
    """Truncate a free rotor to its two rigid modes and its lowest bending modes in each plane.

    The rigid modes are exact: translation, and rotation about the centre of mass with dx/dz > 0. A bending mode is
    positive at the first node where it reaches half its largest displacement.

    Parameters
    ----------
    model : BeamModel
        Rotor whose two planes are equal.
    flexible_modes : int
        Number of bending modes kept in each plane.
    modal_damping : float or sequence of float
        Damping ratio of all bending modes or of each [-]; rigid modes have none. Values beyond the kept modes are
        not used.
    bending_frequencies_hz : sequence of float, optional
        Measured free-free frequencies at rest [Hz], lowest first. They replace the computed ones, the shapes stay;
        modes without a measured value keep the computed one, and values beyond the kept modes are not used.

    Returns
    -------
    ReducedRotor
        2 + `flexible_modes` modes in each plane.

    Raises
    ------
    RigError
        More modes than the model has, too few damping ratios, a measured frequency that is not the computed one within
        a factor of two, or a model that is not free.
    """
    rigid = _rigid_modes(model)
    computed, bending = _bending_modes(model, rigid, flexible_modes)
    measured = () if bending_frequencies_hz is None else bending_frequencies_hz
    shapes = np.column_stack([rigid, bending])
    T_R = _in_both_planes(shapes)
    if model.given_G is None:
        coupling = shapes.T @ model.plane.polar @ shapes
        gyroscopic = np.block([[np.zeros_like(coupling), coupling], [-coupling.T, np.zeros_like(coupling)]])
    else:
        gyroscopic = T_R.T @ model.given_G @ T_R
    return ReducedRotor(
        frequencies_rad_s=np.concatenate([[0.0, 0.0], _with_measured(computed, measured)]),
        damping=np.concatenate([[0.0, 0.0], _damping_ratios(modal_damping, flexible_modes)]),
        gyroscopic=(gyroscopic - gyroscopic.T) / 2.0,
        T_R=T_R,
        T_L=_in_both_planes(model.plane.mass @ shapes).T,
        positions=model.z,
        shapes=shapes[::2],
        between=True,
    )


def _in_both_planes(columns: FloatArray) -> FloatArray:
    """Columns of one plane, (2 n, m), among all freedoms, (4 n, 2 m): first those of plane x, then of plane y."""
    (x, _), (y, signs) = plane_freedoms(len(columns) // 2)
    count = columns.shape[1]
    both = np.zeros((2 * len(columns), 2 * count))
    both[x, :count], both[y, count:] = columns, signs[:, None] * columns
    return both


def _rigid_modes(model: BeamModel) -> FloatArray:
    """Translation and rotation about the centre of mass in one plane, (2 n, 2), mass-normalised."""
    translation = np.tile([1.0, 0.0], len(model.z))
    rotation = np.column_stack([model.z - model.centre, np.ones_like(model.z)]).ravel()
    return np.column_stack([translation / np.sqrt(model.mass), rotation / np.sqrt(model.transverse_inertia)])


def _bending_modes(model: BeamModel, rigid: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Frequencies [rad/s], (count,), and mass-normalised shapes, (2 n, count), of one plane's lowest bending modes."""
    mass, stiffness = model.plane.mass, model.plane.stiffness
    available = len(mass) - 2
    if count > available:
        raise RigError(
            f"rotor.flexible_modes = {count}, but a rotor of {len(mass) // 2} nodes has {available} bending modes "
            "in each plane. Keep fewer modes, or give more nodes."
        )
    squares, shapes = lowest_modes(model.z, stiffness, mass, max(2, count))
    held_hz = np.sqrt(np.max(np.abs(np.diag(rigid.T @ stiffness @ rigid)))) / (2.0 * np.pi)
    first_hz = np.sqrt(max(squares[0], 0.0)) / (2.0 * np.pi)
    if not held_hz < _FREE * first_hz:
        raise RigError(
            f"rotor.K holds the rigid rotor (natural frequency {held_hz:g} Hz; allowed is {_FREE:g} of the first "
            f"bending frequency, {first_hz:g} Hz). Leave bearings and supports out of K; a spring to ground is a "
            "[[rotor.support]]."
        )
    # The solver's error grows with the highest frequency of the mesh; freeing the shapes from rigid motion, and a
    # second, small problem on them, make them orthogonal to machine precision.
    shapes = shapes[:, :count] - rigid @ (rigid.T @ mass @ shapes[:, :count])
    squares, mix = eigh(shapes.T @ stiffness @ shapes, shapes.T @ mass @ shapes) if count else (squares[:0], np.eye(0))
    shapes = shapes @ mix
    displacement = shapes[::2]
    first_large = np.argmax(np.abs(displacement) >= 0.5 * np.max(np.abs(displacement), axis=0), axis=0)
    return np.sqrt(squares), shapes * np.sign(displacement[first_large, np.arange(count)])


def _with_measured(computed: FloatArray, measured_hz: Sequence[float]) -> FloatArray:
    """Bending frequencies [rad/s] with the measured ones in place of the computed ones."""
    result = computed.copy()
    for index, value in enumerate(measured_hz[: len(computed)]):
        expected = computed[index] / (2.0 * np.pi)
        if not expected / _SAME_MODE <= value <= expected * _SAME_MODE:
            raise RigError(
                f"rotor.bending_frequencies_hz[{index}] = {value:g} Hz, but this mode of the rotor is computed at "
                f"{expected:g} Hz; allowed is a factor of {_SAME_MODE:g}. Give free-free frequencies at rest in Hz "
                "(not rad/s), lowest first, or correct the rotor's dimensions."
            )
        result[index] = 2.0 * np.pi * value
    return result


def _damping_ratios(given: float | Sequence[float], count: int) -> FloatArray:
    if isinstance(given, int | float):
        return np.full(count, float(given))
    if len(given) < count:
        raise RigError(
            f"rotor.modal_damping has {len(given)} values, but rotor.flexible_modes = {count}. "
            "Give one value for all bending modes, or one for each."
        )
    return np.array(given[:count], dtype=float)


def _given_modes(rotor: ModalRotor) -> ReducedRotor:
    frequencies = 2.0 * np.pi * np.array(rotor.frequencies_hz, dtype=float)
    if np.any(np.diff(frequencies) < 0.0):
        raise RigError(
            f"rotor.frequencies_hz = {list(rotor.frequencies_hz)} has to increase, with the rigid modes (0 Hz) first. "
            "Sort the modes, and with them damping, shapes and gyroscopic."
        )
    count = len(frequencies) - rotor.listed_bending_modes + rotor.bending_modes
    coupling = np.zeros((count, count))
    if rotor.gyroscopic is not None:
        coupling = np.array(rotor.gyroscopic, dtype=float)[:count, :count]
    return ReducedRotor(
        frequencies_rad_s=frequencies[:count],
        damping=np.array(rotor.damping[:count], dtype=float),
        gyroscopic=np.block([[np.zeros_like(coupling), coupling], [-coupling.T, np.zeros_like(coupling)]]),
        T_R=np.eye(2 * count),
        T_L=np.eye(2 * count),
        positions=np.array(rotor.positions, dtype=float),
        shapes=np.array(rotor.shapes[:count], dtype=float).T,
        between=_lie_close(rotor.positions, rotor.bending_modes),
    )


def _point_mass(mass: float) -> ReducedRotor:
    root = np.sqrt(np.array([[mass]]))
    return ReducedRotor(
        frequencies_rad_s=np.zeros(1),
        damping=np.zeros(1),
        gyroscopic=np.zeros((1, 1)),
        T_R=1.0 / root,
        T_L=root,
        positions=np.empty(0),
        shapes=1.0 / root,
        planes=1,
    )
