"""Polynomials over neighbouring lines, of all bands of a record: what the response and the transient are in each.

Most bands are plain polynomials, which are fitted many at a time; those beside a mode have poles, and are refined one
by one. Columns are separated by orthogonal bases; where they cannot be, by the pseudo-inverse.

Towards zero a loop has more poles than that within a band. But its response at -f is the conjugate of that at f: the
lowest band is taken with its mirror image, so that as many lines give a polynomial of twice the degree over one that
has the poles of three modes, or of integrators.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import ComplexArray, FloatArray


class Form(NamedTuple):
    """What is fitted to a band.

    Attributes
    ----------
    degree : int
        Of the polynomials.
    order : int
        Of the one that all responses may be divided by.
    images : int
        How often every line is there: twice with mirror images.
    """

    degree: int
    order: int
    images: int = 1


DEGREE = 3
"""Of the polynomials: beside two poles it leaves two numbers for what is further away."""
USUAL = Form(DEGREE, 2)
"""Two poles within reach of a band, such as those of a mode."""
LOWEST = Form(2 * DEGREE + 1, 6, 2)
"""The same of the lowest band and its mirror image: as many real numbers as complex ones elsewhere. Three pairs of
poles: the two rigid modes of a plane, and integrators."""
SHARPER = 50.0
"""Fall of the whitened sum of squares from which on a band takes such a polynomial: where there is nothing but noise
two poles are free to be anywhere, and bring that much in one of a hundred bands."""
FREE = 10
"""Lines of a band beyond the numbers that are fitted to them: so many degrees of freedom determine its noise."""
NODES = np.polynomial.legendre.leggauss(DEGREE + 1)[0]
"""Gauss's points, in half widths of a band."""
APART = 1e-6
"""Part of a column, of length 1, that must be at right angles to those before it for a basis to separate them."""
LEAST = 1e-8
"""Singular value of such columns, over the largest, below which they are taken to be alike."""
TOGETHER = 1 << 18
"""Numbers of a table that is fitted at a time: 4 MB, and some ten milliseconds in which nothing interrupts."""


class Bands(NamedTuple):
    """Bands of equally many lines.

    Attributes
    ----------
    response : ndarray, shape (bands, nodes, channels, inputs)
    spread : ndarray, shape (bands, nodes, inputs, inputs)
        Variance of the response of a channel, by the power of its noise.
    shared : dict of int to ndarray, shape (nodes, channels * inputs, orders)
        Of bands with common poles, what errors of these make of all pairs: columns of a root of their covariance.
    left : ndarray, shape (bands, lines, channels)
        What is no such response.
    free : ndarray, shape (bands,)
        Degrees of freedom of a channel of it.
    """

    response: ComplexArray
    spread: ComplexArray
    shared: dict[int, ComplexArray]
    left: ComplexArray
    free: FloatArray


def fitted_bands(u: ComplexArray, z: ComplexArray) -> Bands:
    """Polynomials, or, where that explains more than chance would, polynomials over one that all pairs share.

    Parameters
    ----------
    u, z : ndarray, shape (bands, lines, inputs), (bands, lines, channels)
    """
    bands, lines, inputs = u.shape
    columns = (DEGREE + 1) * (inputs + 1)
    step = max(1, TOGETHER // (lines * max(columns, USUAL.order * z.shape[2])))
    x = np.linspace(-1.0, 1.0, lines)
    at = x[nodes(lines)]
    parts = [_fitted(u[k : k + step], z[k : k + step], x, at, USUAL) for k in range(0, bands, step)]
    shared = {k * step + band: own for k, part in enumerate(parts) for band, own in part.shared.items()}
    response, spread, left, free = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("response", "spread", "left", "free")
    )
    return Bands(response, spread, shared, left, free)


def lowest_band(u: ComplexArray, z: ComplexArray) -> Bands:
    """The band next to zero, whose lines count half as much each with their mirror images.

    Parameters
    ----------
    u, z : ndarray, shape (lines, inputs), (lines, channels)
    """
    x = np.arange(1, len(u) + 1) / len(u)
    both_u, both_z = (np.concatenate([own[::-1].conj(), own])[None] for own in (u, z))
    both = np.concatenate([-x[::-1], x])
    found = _fitted(both_u, both_z, both, x[lowest_nodes(len(u))], LOWEST)
    return found._replace(left=found.left[:, len(u) :], free=0.5 * found.free)


def nodes(count: int) -> NDArray[np.intp]:
    """Which lines of a band are nearest to Gauss's points."""
    return np.rint(0.5 * (count - 1) * (1.0 + NODES)).astype(np.intp)


def lowest_nodes(count: int) -> NDArray[np.intp]:
    """The same of a band and its mirror image, on its own side."""
    points = np.polynomial.legendre.leggauss(2 * (DEGREE + 1))[0][DEGREE + 1 :]
    return np.rint(count * points).astype(np.intp) - 1


def _fitted(u: ComplexArray, z: ComplexArray, x: FloatArray, at: FloatArray, form: Form) -> Bands:
    """Bands that are fitted at a time, with lines at x, and given at `at`."""
    bands, lines, inputs = u.shape
    driving: ComplexArray = np.concatenate([u, np.ones((bands, lines, 1))], axis=2)
    table = np.asarray(driving[..., None] * _powers(x, form.degree)[:, None, :]).reshape(bands, lines, -1)
    numbers, inverse, across, alike = _least_squares(table, z)
    left = across @ (_adjoint(across) @ z)
    poles, squares = _common_poles(across, z, x, form.order)
    for k in alike:
        left[k] = z[k] - table[k] @ numbers[k]
        poles[k], squares[k] = (own[0] for own in _common_poles(_complement(table[k])[None], z[k][None], x, form.order))
    free = lines - table.shape[2]
    power = squares / free
    fall = 2.0 * np.sum(np.sum(np.abs(left) ** 2, axis=1) / power, axis=1) - 2.0 * free * z.shape[2]
    regressors = _regressors(at, inputs, poles[0, :0], form.degree)
    spread = regressors @ (inverse @ _adjoint(inverse))[:, None] @ _adjoint(regressors)
    response = (regressors @ numbers[:, None]).swapaxes(2, 3)
    found = Bands(response, spread, {}, left, np.full(bands, float(free)))
    for k in np.flatnonzero(fall > SHARPER * form.images).tolist():
        own = _with_poles(table[k], z[k], x, at, poles[k], power[k], form.degree)
        found.response[k], found.spread[k], found.shared[k], found.left[k] = own
        found.free[k] = free - form.order / z.shape[2]
    return found


def _least_squares(
    table: ComplexArray, z: ComplexArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray, NDArray[np.intp]]:
    """Numbers, what makes them of z, a basis of all that is at right angles to the columns, and where these are alike.

    Where columns are alike, the basis lacks what only seems to be determined by them.
    """
    columns = table.shape[2]
    size = np.linalg.norm(table, axis=1)
    basis, upper = np.linalg.qr(table / size[:, None], mode="complete")
    upper = upper[:, :columns]
    alike = np.flatnonzero(np.abs(np.diagonal(upper, axis1=1, axis2=2)).min(axis=1) < APART)
    upper[alike] = np.eye(columns)
    inverse = np.linalg.solve(upper, _adjoint(basis[:, :, :columns])) / size[:, :, None]
    numbers = inverse @ z
    for k in alike:
        numbers[k], inverse[k], _ = _by_pseudo_inverse(table[k], z[k])
    return numbers, inverse, basis[:, :, columns:], alike


def _complement(table: ComplexArray) -> ComplexArray:
    """All that is at right angles to columns that may be alike, (lines, lines - rank)."""
    basis, values, _ = np.linalg.svd(table / np.linalg.norm(table, axis=0))
    return np.asarray(basis[:, int(np.sum(values > LEAST * values[0])) :])


def _by_pseudo_inverse(table: ComplexArray, z: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Numbers, what makes them of z, and what is left, of one band whose columns may be alike."""
    size = np.linalg.norm(table, axis=0)
    inverse = np.linalg.pinv(table / size, rcond=LEAST) / size[:, None]
    numbers = inverse @ z
    return numbers, inverse, z - table @ numbers


def _common_poles(across: ComplexArray, z: ComplexArray, x: FloatArray, order: int) -> tuple[ComplexArray, FloatArray]:
    """Coefficients of the polynomial under all responses, from the first power on, and squares of what is left with it.

    Found by linear least squares, again and again, each time weighted by the polynomial found before (Sanathanan and
    Koerner, IEEE Trans. Autom. Control 8 (1963) 56). Columns that are divided by a polynomial are at right angles to
    what was so before, times its conjugate: a few directions, `across`, that contain all of it.
    """
    bands, lines, channels = z.shape
    powers = _powers(x, order)
    below, here = np.ones((bands, lines), dtype=complex), across
    poles, squares = np.zeros((bands, order), dtype=complex), _squares(across, z)
    for _ in range(4):
        even = z / below[:, :, None] / np.sqrt(squares / lines)[:, None]
        stacked = (powers[:, :, None] * even[:, :, None, :]).reshape(bands, lines, -1)
        seen = (_adjoint(here) @ stacked).reshape(bands, -1, order + 1, channels).swapaxes(2, 3)
        seen = seen.reshape(bands, -1, order + 1)
        poles = -_solved(seen[:, :, 1:], seen[:, :, 0])
        below = 1.0 + poles @ powers[:, 1:].T
        here, _ = np.linalg.qr(below.conj()[:, :, None] * across)
        squares = _squares(here, z)
    return poles, squares


def _squares(across: ComplexArray, z: ComplexArray) -> FloatArray:
    """Of what is left of each channel, (bands, channels)."""
    return np.asarray(np.sum(np.abs(_adjoint(across) @ z) ** 2, axis=1))


def _solved(columns: ComplexArray, of: ComplexArray) -> ComplexArray:
    """Least squares in a few columns, of many bands at a time, (bands, columns)."""
    basis, upper = np.linalg.qr(columns)
    size = np.abs(np.diagonal(upper, axis1=1, axis2=2))
    alike = np.flatnonzero(size.min(axis=1) <= APART * size.max(axis=1))
    upper[alike] = np.eye(upper.shape[1])
    found = np.linalg.solve(upper, _adjoint(basis) @ of[..., None])[..., 0]
    for k in alike:
        found[k] = np.linalg.lstsq(columns[k], of[k], rcond=1e-10)[0]
    return np.asarray(found)


def _with_poles(
    table: ComplexArray,
    z: ComplexArray,
    x: FloatArray,
    at: FloatArray,
    poles: ComplexArray,
    power: FloatArray,
    degree: int,
) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
    """Response, spread, shared and what is left of one band, by steps of Gauss and Newton from the poles found."""
    lines, inputs, free = len(z), table.shape[1] // (degree + 1) - 1, len(z) - table.shape[1]
    fit = _by_pseudo_inverse(table / _below(x, poles)[:, None], z)
    for _ in range(3):  # to least squares: without, a mode narrower than the lines lie has twice the variance
        own, _ = _by_poles(table, z, x, poles, fit)
        own = own / np.sqrt(power)
        information = np.einsum("lkc,lmc->km", own.conj(), own)
        pull = np.einsum("lkc,lc->k", own.conj(), fit[2] / np.sqrt(power))
        step = np.linalg.pinv(information, hermitian=True) @ pull
        closer = _by_pseudo_inverse(table / _below(x, poles + step)[:, None], z)
        if not np.linalg.norm(closer[2] / np.sqrt(power)) < np.linalg.norm(fit[2] / np.sqrt(power)):
            break
        poles, fit = poles + step, closer
    numbers, inverse, left = fit
    regressors = _regressors(at, inputs, poles, degree)
    spread = regressors @ (inverse @ inverse.conj().T) @ _adjoint(regressors)
    response = (regressors @ numbers).transpose(0, 2, 1)
    own, taken = _by_poles(table, z, x, poles, fit)
    own = own / np.sqrt(power)
    covering = np.linalg.pinv(np.einsum("lkc,lmc->km", own.conj(), own), hermitian=True)
    # channels go together, lines do not
    pull = np.einsum("lkc,lc->lk", own.conj(), left / np.sqrt(power))
    meat = pull.T @ pull.conj() * lines / free
    values, vectors = np.linalg.eigh(covering @ meat @ covering)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    direct = -(_powers(at, len(poles))[:, 1:] / _below(at, poles)[:, None])[:, None, None, :] * response[..., None]
    moved = direct - np.einsum("njq,qkc->ncjk", regressors, taken)
    return response, spread, moved.reshape(len(at), -1, len(poles)) @ root, left


def _by_poles(
    table: ComplexArray,
    z: ComplexArray,
    x: FloatArray,
    poles: ComplexArray,
    fit: tuple[ComplexArray, ComplexArray, ComplexArray],
) -> tuple[ComplexArray, ComplexArray]:
    """Derivative of what is fitted by the coefficients below, (lines, orders, channels), and what the numbers take."""
    below, (_, inverse, left) = _below(x, poles), fit
    bent = -(_powers(x, len(poles))[:, 1:] / below[:, None])[:, :, None] * (z - left)[:, None, :]
    taken = np.einsum("ql,lkc->qkc", inverse, bent)
    return bent - np.einsum("lq,qkc->lkc", table / below[:, None], taken), taken


def _regressors(at: FloatArray, inputs: int, poles: ComplexArray, degree: int) -> ComplexArray:
    """What makes values at the nodes of the numbers: of each input its polynomial, nothing of the transient."""
    regressors = np.zeros((len(at), inputs, inputs + 1, degree + 1), dtype=complex)
    for j in range(inputs):
        regressors[:, j, j] = _powers(at, degree) / _below(at, poles)[:, None]
    return regressors.reshape(len(at), inputs, -1)


def _below(x: FloatArray, poles: ComplexArray) -> ComplexArray:
    """The polynomial under all responses."""
    return np.asarray(1.0 + _powers(x, len(poles))[:, 1:] @ poles)


def _powers(x: FloatArray, degree: int) -> FloatArray:
    return np.vander(x, degree + 1, increasing=True)


def _adjoint(matrices: ComplexArray) -> ComplexArray:
    return matrices.conj().swapaxes(-1, -2)
