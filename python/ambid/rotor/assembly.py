"""The beam model of a rotor: of finite elements, fine enough for the frequencies that are kept, or of given matrices.

Matrices are held against what the reduction relies on: two equal planes, G skew-symmetric.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import eigsh

from ambid.arrays import FloatArray
from ambid.errors import RigError
from ambid.rig import FiniteElementRotor, Material, MatrixRotor, Section
from ambid.rig.rotor import SAME_PLACE
from ambid.rotor.beam import PlaneMatrices, beam_element, both_planes, conical_element, plane_bases, plane_freedoms

_EQUAL = 1e-9  # of the largest entry of a matrix that is given
_MANY = 150  # freedoms from which on few modes of a narrow band are found faster one by one


@dataclass(frozen=True)
class BeamModel:
    """Free rotor as nodes on an axis: M q'' + speed G q' + K q = f, freedoms [u_x, u_y, theta_x, theta_y] a node.

    Attributes
    ----------
    z : ndarray, shape (n,)
        Positions of the nodes [m], increasing.
    plane : PlaneMatrices
        Mass, stiffness and polar inertia of either plane, which are alike.
    given_G : ndarray, shape (4 n, 4 n), optional
        Gyroscopic matrix per rad/s where more is known of it than the polar inertia.
    """

    z: FloatArray
    plane: PlaneMatrices
    given_G: FloatArray | None = None

    @property
    def M(self) -> FloatArray:
        """Mass matrix, shape (4 n, 4 n); like G and K it is for those who want it whole, and made when asked for."""
        return self._whole[0]

    @property
    def G(self) -> FloatArray:
        """Gyroscopic matrix per rad/s, shape (4 n, 4 n), skew-symmetric."""
        return self._whole[1] if self.given_G is None else self.given_G

    @property
    def K(self) -> FloatArray:
        """Stiffness matrix, shape (4 n, 4 n)."""
        return self._whole[2]

    @cached_property
    def _whole(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return both_planes(self.plane)

    @cached_property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self._translation @ self.plane.mass @ self._translation)

    @cached_property
    def centre(self) -> float:
        """Axial position of the centre of mass [m]."""
        return float(self._translation @ self.plane.mass @ self._rotation) / self.mass

    @cached_property
    def transverse_inertia(self) -> float:
        """Moment of inertia about a transverse axis through the centre of mass [kg m^2]."""
        about_centre = self._rotation - self.centre * self._translation
        return float(about_centre @ self.plane.mass @ about_centre)

    @property
    def _translation(self) -> FloatArray:
        return np.tile([1.0, 0.0], len(self.z))

    @property
    def _rotation(self) -> FloatArray:
        """Unit rotation about z = 0."""
        return np.column_stack([self.z, np.ones_like(self.z)]).ravel()


def place_of(z: float, positions: FloatArray) -> int:
    """Index of the position that `z` means.

    Parameters
    ----------
    z : float
        Axial position [m].
    positions : ndarray, shape (n,)
        Positions where the rotor is known [m].

    Returns
    -------
    int
        Index into `positions`.

    Raises
    ------
    RigError
        None within 1e-6 m; the message names the nearest ones.
    """
    distance = np.abs(positions - z)
    nearest = np.argsort(distance, kind="stable")[:2]
    if not distance[nearest[0]] <= SAME_PLACE:
        allowed = ", ".join(f"{positions[i]:g}" for i in sorted(nearest))
        raise RigError(
            f"position {z:g} m is not a place at which the rotor is known; the nearest ones are {allowed} m. "
            "Use one of them, or describe the rotor at more positions: it is known between them, too, where they lie "
            "within 0.3 of a half-wave of its highest bending mode."
        )
    return int(nearest[0])


def assemble(rotor: FiniteElementRotor, nodes_at: Sequence[float]) -> BeamModel:
    """Finite-element model of a shaft with disks, free of any support.

    Nodes lie at section ends, disks and `nodes_at`. The elements between them are halved until the `flexible_modes`
    kept frequencies change by less than 0.01 %; the finer of the last two meshes is returned.

    Parameters
    ----------
    rotor : FiniteElementRotor
        Sections from z = 0 on, disks, material and the number of bending modes that will be kept.
    nodes_at : sequence of float
        Further places that need a node, such as bearings and sensors [m].

    Returns
    -------
    BeamModel
        Matrices at rest, and G per rad/s.

    Raises
    ------
    RigError
        One of `nodes_at` off the shaft, or more modes than a beam model can bear.
    """
    ends = np.cumsum([0.0, *(section.length for section in rotor.section)])
    for position in nodes_at:
        if not -SAME_PLACE <= position <= ends[-1] + SAME_PLACE:
            raise RigError(
                f"position of a bearing or sensor = {position:g} m is off the shaft, which reaches from 0 to "
                f"{ends[-1]:g} m (the sum of the lengths in rotor.section). Correct the position or the sections."
            )
    places = _places(ends, [*(disk.position for disk in rotor.disk), *nodes_at])

    longest = min(float(np.max(np.diff(places))), ends[-1] / (4.0 + 2.0 * rotor.flexible_modes))
    z, plane = _mesh(rotor, ends, places, longest)
    frequencies = _bending_frequencies(z, plane, rotor.flexible_modes)
    change = np.inf
    # largest relative change of a kept frequency when the elements are halved
    while rotor.flexible_modes > 0 and change >= 1e-4:
        if 2 * len(z) > max(400, 4 * len(places)):  # unless the rotor's own sections and disks ask for more
            if change < 5e-4:  # the same where more nodes would be too many
                break
            raise RigError(
                f"rotor.flexible_modes = {rotor.flexible_modes}: the highest of these modes is not converged with "
                f"{len(z)} nodes, so that a beam model cannot determine it. Keep fewer modes."
            )
        coarse, longest = frequencies, longest / 2.0
        z, plane = _mesh(rotor, ends, places, longest)
        frequencies = _bending_frequencies(z, plane, rotor.flexible_modes)
        change = float(np.max(np.abs(frequencies / coarse - 1.0)))
    return BeamModel(z, plane)


def _places(ends: FloatArray, others: Sequence[float]) -> FloatArray:
    """Section ends and those other positions that are not one place with an earlier one, sorted."""
    places = list(ends)
    for position in others:
        if min(abs(position - place) for place in places) > SAME_PLACE:
            places.append(position)
    return np.sort(np.array(places))


def _mesh(
    rotor: FiniteElementRotor, ends: FloatArray, places: FloatArray, longest: float
) -> tuple[FloatArray, PlaneMatrices]:
    """Nodes and one-plane matrices with a node at every place and no element longer than `longest`."""
    pieces = np.ceil(np.diff(places) / longest - 1e-9).astype(int)
    spans = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(places[:-1], places[1:], pieces, strict=True)]
    z = np.concatenate([*spans, places[-1:]])

    size = 2 * len(z)
    plane = PlaneMatrices(np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size)))
    section_of = np.searchsorted(ends, (z[:-1] + z[1:]) / 2.0) - 1
    for first, index in enumerate(section_of):
        here = slice(2 * first, 2 * first + 4)
        along = z[first : first + 2] - ends[index]
        for whole, part in zip(plane, _section_element(rotor.section[index], rotor.material, along), strict=True):
            whole[here, here] += part
    for disk in rotor.disk:
        node = 2 * place_of(disk.position, z)
        plane.mass[node, node] += disk.mass
        plane.mass[node + 1, node + 1] += disk.transverse_inertia
        plane.polar[node + 1, node + 1] += disk.polar_inertia
    return z, plane


def _section_element(section: Section, of_rotor: Material | None, along: FloatArray) -> PlaneMatrices:
    """Element between two places of a section, counted from where it begins [m]."""
    material = section.material or of_rotor
    assert material is not None  # the rotor was refused otherwise
    of_material = material.density, material.youngs_modulus, material.poisson_ratio
    length = float(along[1] - along[0])
    if section.outer_diameter_end is None:
        return beam_element(length, section.outer_diameter, section.inner_diameter, *of_material)
    steeper = (section.outer_diameter_end - section.outer_diameter) / section.length
    first, last = (section.outer_diameter + steeper * along).tolist()
    return conical_element(length, (first, last), section.inner_diameter, *of_material)


def _bending_frequencies(z: FloatArray, plane: PlaneMatrices, count: int) -> FloatArray:
    """Lowest free-free bending frequencies [rad/s]; the two rigid modes of the plane are passed over."""
    if count == 0:
        return np.empty(0)
    return np.sqrt(lowest_modes(z, plane.stiffness, plane.mass, count)[0])


def lowest_modes(z: FloatArray, stiffness: FloatArray, mass: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest modes of one plane beyond the first two, which are the rigid ones.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Positions of the nodes [m].
    stiffness, mass : ndarray, shape (2 n, 2 n)
        With the freedoms [u, psi] of each node.
    count : int
        At least 1.

    Returns
    -------
    squares : ndarray, shape (count,)
        Of the natural frequencies [rad^2/s^2], lowest first.
    shapes : ndarray, shape (2 n, count)
    """
    wanted = count + 2
    narrow = csc_array(stiffness) if len(mass) >= _MANY else None
    # entries a freedom up to which a matrix is a narrow band; a chain of beams has six
    if narrow is None or narrow.nnz > 12 * len(mass) or 4 * wanted > len(mass):
        return eigh(stiffness, mass, subset_by_index=[2, wanted - 1])
    # Lanczos from below: a parabola bends about as the first mode does, and shows where the spectrum begins
    bent = np.column_stack([(z - z.mean()) ** 2, 2.0 * (z - z.mean())]).ravel()
    begins = (bent @ stiffness @ bent) / (bent @ mass @ bent)
    start = np.cos(np.arange(len(mass)))  # any vector that holds something of every mode, always the same
    squares, shapes = eigsh(narrow, wanted, M=csc_array(mass), sigma=-begins, v0=start)
    order = np.argsort(squares)[2:]
    return squares[order], shapes[:, order]


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
