"""Timoshenko beam elements of a round shaft, and how its two bending planes fill four freedoms a node.

The shaft is isotropic, so the element is written for one plane with the freedoms [u, psi], psi = du/dz less shear,
and laid into both. Source: Friswell, Penny, Garvey and Lees, "Dynamics of Rotating Machines" (2010), chapter 5;
Nelson, "A finite rotating shaft element using Timoshenko beam theory", J. Mech. Design 102 (1980) 793-803.
"""

from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray, IndexArray


class PlaneMatrices(NamedTuple):
    """Matrices of one bending plane, freedoms [u, psi] of node after node.

    Attributes
    ----------
    mass, stiffness : ndarray, shape (2 n, 2 n)
        Consistent mass with rotary inertia, and stiffness; SI units.
    polar : ndarray, shape (2 n, 2 n)
        Symmetric matrix of the polar inertia [kg m^2]: plane x feels + speed * polar @ (velocity of plane y).
    """

    mass: FloatArray
    stiffness: FloatArray
    polar: FloatArray


def shear_coefficient(outer_diameter: float, inner_diameter: float, poisson_ratio: float) -> float:
    """Timoshenko shear coefficient of a solid or hollow circular section.

    Parameters
    ----------
    outer_diameter, inner_diameter : float
        Diameters [m]; an inner diameter of zero is the solid section.
    poisson_ratio : float
        Poisson's ratio [-].

    Returns
    -------
    float
        kappa [-], so that the shear stiffness is kappa G A.

    References
    ----------
    Cowper, "The shear coefficient in Timoshenko's beam theory", J. Appl. Mech. 33 (1966) 335-340. Hutchinson's value,
    J. Appl. Mech. 68 (2001) 87-92, is larger by 4 % for solid steel and raises the frequencies a little.
    """
    nu, squares = poisson_ratio, outer_diameter**2 + inner_diameter**2
    hollow = (outer_diameter * inner_diameter / squares) ** 2
    return 6.0 * (1.0 + nu) / (7.0 + 6.0 * nu + (20.0 + 12.0 * nu) * hollow)


def beam_element(
    length: float,
    outer_diameter: float,
    inner_diameter: float,
    density: float,
    youngs_modulus: float,
    poisson_ratio: float,
) -> PlaneMatrices:
    """Timoshenko element of one bending plane, freedoms [u_1, psi_1, u_2, psi_2].

    Parameters
    ----------
    length, outer_diameter, inner_diameter : float
        Length of the element and diameters of its section [m].
    density : float
        Density [kg/m^3].
    youngs_modulus : float
        Young's modulus [Pa].
    poisson_ratio : float
        Poisson's ratio [-].

    Returns
    -------
    PlaneMatrices
        Mass, stiffness and polar inertia, each (4, 4).

    References
    ----------
    Friswell et al. (2010), chapter 5; Nelson (1980).
    """
    area = np.pi / 4.0 * (outer_diameter**2 - inner_diameter**2)
    second_moment = np.pi / 64.0 * (outer_diameter**4 - inner_diameter**4)
    bending = youngs_modulus * second_moment
    shear_modulus = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    kappa = shear_coefficient(outer_diameter, inner_diameter, poisson_ratio)
    phi = 12.0 * bending / (kappa * shear_modulus * area * length**2)

    to_metres = np.array([1.0, length, 1.0, length])  # psi times length, so that every freedom is a displacement
    units = np.outer(to_metres, to_metres)

    m1, m2 = 312.0 + 588.0 * phi + 280.0 * phi**2, 44.0 + 77.0 * phi + 35.0 * phi**2
    m3, m4 = 108.0 + 252.0 * phi + 140.0 * phi**2, -(26.0 + 63.0 * phi + 35.0 * phi**2)
    m5, m6 = 8.0 + 14.0 * phi + 7.0 * phi**2, -(6.0 + 14.0 * phi + 7.0 * phi**2)
    translation = np.array([[m1, m2, m3, m4], [m2, m5, -m4, m6], [m3, -m4, m1, -m2], [m4, m6, -m2, m5]])
    translation *= units * density * area * length / (840.0 * (1.0 + phi) ** 2)

    r1, r2 = 36.0, 3.0 - 15.0 * phi
    r3, r4 = 4.0 + 5.0 * phi + 10.0 * phi**2, -1.0 - 5.0 * phi + 5.0 * phi**2
    rotary = np.array([[r1, r2, -r1, r2], [r2, r3, -r2, r4], [-r1, -r2, r1, -r2], [r2, r4, -r2, r3]])
    rotary *= units * density * second_moment / (30.0 * length * (1.0 + phi) ** 2)

    k1, k2 = 4.0 + phi, 2.0 - phi
    stiffness = np.array([[12.0, 6.0, -12.0, 6.0], [6.0, k1, -6.0, k2], [-12.0, -6.0, 12.0, -6.0], [6.0, k2, -6.0, k1]])
    stiffness *= units * bending / (length**3 * (1.0 + phi))

    # A round section turns about its axis with twice the inertia that it tilts with.
    return PlaneMatrices(mass=translation + rotary, stiffness=stiffness, polar=2.0 * rotary)


def conical_element(
    length: float,
    outer_diameters: tuple[float, float],
    inner_diameter: float,
    density: float,
    youngs_modulus: float,
    poisson_ratio: float,
) -> PlaneMatrices:
    """Timoshenko element of one bending plane whose outer diameter changes in proportion to z.

    Its stiffness is the inverse of the flexibility of all sections, and exact. The shape functions of its mass are
    those of a cylinder with the section half-way: mass and inertias of rigid motions are exact.

    Parameters
    ----------
    length : float
        Of the element [m].
    outer_diameters : (float, float)
        Where it begins and ends [m].
    inner_diameter : float
        Of the bore [m], the same all along.
    density, youngs_modulus, poisson_ratio : float
        As for `beam_element`.

    Returns
    -------
    PlaneMatrices
        Mass, stiffness and polar inertia, each (4, 4), freedoms [u_1, psi_1, u_2, psi_2].

    References
    ----------
    Friswell et al. (2010), chapter 5: shape functions; Przemieniecki, Theory of Matrix Structural Analysis (1968),
    chapter 5: stiffness by the flexibility of a clamped element.
    """
    first, last = outer_diameters
    # points of an integral along a cone: exact for its mass, of degree 8, and to 1e-8 for its flexibility where one end
    # is twice as wide as the other
    points, weights = np.polynomial.legendre.leggauss(8)
    x, weights = (points + 1.0) / 2.0, weights * length / 2.0
    outer = first + (last - first) * x
    area, second_moment = _section(outer, inner_diameter)
    middle = (first + last) / 2.0
    middle_area, middle_moment = _section(np.array(middle), inner_diameter)
    shear_modulus = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    shear = np.array([shear_coefficient(d, inner_diameter, poisson_ratio) for d in outer]) * shear_modulus
    middle_shear = shear_coefficient(middle, inner_diameter, poisson_ratio) * shear_modulus * float(middle_area)
    phi = 12.0 * youngs_modulus * float(middle_moment) / (middle_shear * length**2)

    cubic = 3.0 * x**2 - 2.0 * x**3
    u = np.array(
        [
            1.0 + phi - phi * x - cubic,
            length / 2.0 * ((2.0 + phi) * x - (4.0 + phi) * x**2 + 2.0 * x**3),
            phi * x + cubic,
            length / 2.0 * (-phi * x - (2.0 - phi) * x**2 + 2.0 * x**3),
        ]
    ) / (1.0 + phi)
    psi = np.array(
        [
            6.0 / length * (x**2 - x),
            1.0 + phi - (4.0 + phi) * x + 3.0 * x**2,
            6.0 / length * (x - x**2),
            -(2.0 - phi) * x + 3.0 * x**2,
        ]
    ) / (1.0 + phi)
    # A force and a moment at the end bend the element, clamped where it begins.
    lever, per_bending, per_shear = (1.0 - x) * length, 1.0 / (youngs_modulus * second_moment), 1.0 / (shear * area)
    loads = np.array([lever, np.ones_like(x)])
    flexibility = _integral(loads, weights * per_bending)
    flexibility[0, 0] += weights @ per_shear
    bent = np.array([[-1.0, -length, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])  # what is left of a motion less a rigid one
    rotary = _integral(psi, weights * density * second_moment)
    return PlaneMatrices(
        mass=_integral(u, weights * density * area) + rotary,
        stiffness=bent.T @ np.linalg.solve(flexibility, bent),
        polar=2.0 * rotary,
    )


def _section(outer: FloatArray, inner: float) -> tuple[FloatArray, FloatArray]:
    """Area [m^2] and second moment [m^4] of round sections."""
    return np.pi / 4.0 * (outer**2 - inner**2), np.pi / 64.0 * (outer**4 - inner**4)


def _integral(shapes: FloatArray, weights: FloatArray) -> FloatArray:
    """Products of functions, (n, points), summed with weights, (n, n)."""
    return np.asarray((shapes * weights) @ shapes.T)


def plane_bases(nodes: int) -> tuple[FloatArray, FloatArray]:
    """Where the two bending planes sit among the freedoms [u_x, u_y, theta_x, theta_y] of each node.

    theta is right-handed about its axis, so theta_y = psi_x but theta_x = -psi_y.

    Parameters
    ----------
    nodes : int
        Number of nodes n.

    Returns
    -------
    tuple of ndarray
        X and Y, each (4 n, 2 n), with orthonormal columns: q = X [u_x, psi_x, ...] + Y [u_y, psi_y, ...].
    """
    x, y = np.zeros((4 * nodes, 2 * nodes)), np.zeros((4 * nodes, 2 * nodes))
    for basis, (freedoms, signs) in zip((x, y), plane_freedoms(nodes), strict=True):
        basis[freedoms, np.arange(2 * nodes)] = signs
    return x, y


def plane_freedoms(nodes: int) -> tuple[tuple[IndexArray, FloatArray], tuple[IndexArray, FloatArray]]:
    """Which freedoms each plane has among all, and with what sign; see `plane_bases`, of which it is the short form.

    Parameters
    ----------
    nodes : int
        Number of nodes n.

    Returns
    -------
    tuple of (ndarray, ndarray)
        Indices and signs, (2 n,) each, of plane x and of plane y.
    """
    first = 4 * np.arange(nodes, dtype=np.intp)[:, None]
    x, y = (np.asarray(first + own).ravel() for own in ([0, 3], [1, 2]))
    return (x, np.ones(2 * nodes)), (y, np.tile([1.0, -1.0], nodes))


def both_planes(plane: PlaneMatrices) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Matrices of M q'' + speed G q' + K q = f from those of one plane.

    Parameters
    ----------
    plane : PlaneMatrices
        Matrices of n nodes in one plane.

    Returns
    -------
    tuple of ndarray
        M, G (skew-symmetric, for a speed in rad/s) and K, each (4 n, 4 n), SI units.
    """
    nodes = len(plane.mass) // 2
    (x, _), (y, signs) = plane_freedoms(nodes)
    M, G, K = (np.zeros((4 * nodes, 4 * nodes)) for _ in range(3))
    for whole, part in ((M, plane.mass), (K, plane.stiffness)):
        whole[np.ix_(x, x)] = part
        whole[np.ix_(y, y)] = signs[:, None] * part * signs
    coupling = plane.polar * signs
    G[np.ix_(x, y)] = coupling
    G[np.ix_(y, x)] = -coupling.T
    return M, G, K
