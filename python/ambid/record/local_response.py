"""The frequency response of a record in time, by local polynomials over neighbouring lines.

On the lines l of the discrete Fourier transform of a stretch of a record,

    Z(l) = H(l) U(l) + T(l) + noise,

the response H and the transient T are smooth over frequency, while the excitations U of several axes, of different
sequences, are not: over a few neighbouring lines both are polynomials of degree three, which least squares tell apart
(Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapter 7). Near a pole they are
such polynomials over another one, which all of them share, since they have the poles of one loop (McKelvey and Guerin,
16th IFAC Symposium on System Identification, 2012); its errors are in the covariance. Bands do not overlap.
In each H is told at the lines next to the four points of Gauss's quadrature, where the errors of a cubic are
independent of each other if the lines are excited alike: so what the band tells of H is told, and nothing twice.

Towards zero a loop has more poles than that within a band. But its response at -f is the conjugate of that at f: the
lowest band is taken with its mirror image, so that as many lines tell a polynomial of twice the degree over one that
has the poles of three modes, or of integrators.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError

__all__ = ["LocalResponse", "local_response"]

DEGREE = 3
"""Of the polynomials: beside two poles it leaves two numbers for what is further away."""
ORDER = 2
"""Of the polynomial that all responses may be divided by: two poles within reach of a band, such as those of a mode."""
ROUNDS = 4
"""So often is that polynomial found anew, weighted by the one before."""
STEPS = 3
"""Steps of Gauss and Newton from there to the least squares, of which the covariance is: beside a mode that is narrower
than the lines are apart the error had twice its variance without."""
SHARPER = 50.0
"""Fall of the whitened sum of squares from which on a band takes such a polynomial: where there is nothing but noise
two poles are free to be anywhere, and bring that much in one of a hundred bands."""
FREE = 10
"""Lines of a band beyond the numbers that are fitted to them: so many degrees of freedom tell its noise."""
NODES = np.polynomial.legendre.leggauss(DEGREE + 1)[0]
"""Gauss's points, in half widths of a band."""
MIRRORED = np.polynomial.legendre.leggauss(2 * (DEGREE + 1))[0][DEGREE + 1 :]
"""Those of a band and its mirror image, in widths of the band from zero."""
LOWEST_DEGREE, LOWEST_ORDER = 2 * DEGREE + 1, 6
"""The same of the lowest band and its mirror image: as many real numbers as complex ones elsewhere. Three pairs of
poles: the two rigid modes of a plane, and integrators."""
AROUND = 3
"""Bands to each side that the correlation of the channels is taken from."""
LEAST_EXCITED = 1e-6
"""Power of an axis over that of the loudest below which it is not excited."""


class LocalResponse(NamedTuple):
    """What local polynomials tell.

    Attributes
    ----------
    frequency_hz : ndarray, shape (F,)
    response : ndarray, shape (F, channels, inputs)
    covariance : ndarray, shape (F, pairs, pairs)
    spread : float
        See `FrequencyResponse`; the mean over all bands.
    excited : ndarray of bool, shape (axes,)
        Which axes the inputs are.
    """

    frequency_hz: FloatArray
    response: ComplexArray
    covariance: ComplexArray
    spread: float
    excited: NDArray[np.bool_]


def local_response(
    where: str, drives: FloatArray, outputs: FloatArray, sample_rate: float, period: int | None
) -> LocalResponse:
    """The response of one record.

    Parameters
    ----------
    where : str
        For the messages.
    drives, outputs : ndarray, shape (N, axes), (N, channels)
        What drives it is i_e, r or both.
    sample_rate : float
        [Hz].
    period : int, optional
        In samples; of whole periods only the lines that are excited are looked at.

    Raises
    ------
    RecordError
        If there are too few lines.
    """
    power = np.var(drives, axis=0)
    excited = power > LEAST_EXCITED * power.max(initial=0.0)
    periods = len(drives) // period if period else 1
    samples = periods * period if period and periods else len(drives)
    periods = max(periods, 1)
    index = np.arange(periods, (samples + 1) // 2, periods)
    u, z = (rfft(signal[:samples], axis=0)[index] / np.sqrt(samples) for signal in (drives, outputs))
    u = u[:, excited]
    fitted = (DEGREE + 1) * (u.shape[1] + 1)
    width = fitted + FREE
    count = len(index) // width
    if count == 0:
        raise RecordError(
            f"{where}: {len(index)} excited lines, at least {width} are needed for {u.shape[1]} excited axes; excite "
            "with a longer period, or one axis after the other"
        )
    lowest, *others = np.array_split(np.arange(len(index)), count)
    bands = [_lowest_band(u[lowest], z[lowest]), *(_band(u[rows], z[rows]) for rows in others)]
    place = np.concatenate(
        [index[lowest[_lowest_nodes(len(lowest))]], *(index[own[_nodes(len(own))]] for own in others)]
    )
    noise, spreads = _noise(bands)
    response = np.concatenate([band.response for band in bands])
    covariance = np.concatenate(
        [
            np.einsum("ab,kij->kaibj", own, band.spread).reshape(len(NODES), band.response[0].size, -1)
            + band.shared @ band.shared.conj().transpose(0, 2, 1)
            for own, band in zip(noise, bands, strict=True)
        ]
    )
    return LocalResponse(place * sample_rate / samples, response, covariance, float(np.mean(spreads)), excited)


class _Band(NamedTuple):
    """A band of lines.

    Attributes
    ----------
    response : ndarray, shape (nodes, channels, inputs)
    spread : ndarray, shape (nodes, inputs, inputs)
        Variance of the response of a channel, by the power of its noise.
    shared : ndarray, shape (nodes, channels * inputs, orders)
        What errors of the common poles make of all pairs: columns of a root of their covariance.
    left : ndarray, shape (lines, channels)
        What is no such response.
    free : float
        Degrees of freedom of a channel of it.
    """

    response: ComplexArray
    spread: ComplexArray
    shared: ComplexArray
    left: ComplexArray
    free: float


def _band(u: ComplexArray, z: ComplexArray) -> _Band:
    """What the lines of a band tell."""
    x = np.linspace(-1.0, 1.0, len(u))
    return _told(u, z, x, x[_nodes(len(u))], DEGREE, ORDER, 1)


def _lowest_band(u: ComplexArray, z: ComplexArray) -> _Band:
    """What those next to zero tell, which tell half as much each with their mirror images."""
    x = np.arange(1, len(u) + 1) / len(u)
    both_u, both_z = (np.concatenate([own[::-1].conj(), own]) for own in (u, z))
    nodes, both = x[_lowest_nodes(len(u))], np.concatenate([-x[::-1], x])
    found = _told(both_u, both_z, both, nodes, LOWEST_DEGREE, LOWEST_ORDER, 2)
    return found._replace(left=found.left[len(u) :], free=0.5 * found.free)


def _told(
    u: ComplexArray, z: ComplexArray, x: FloatArray, nodes: FloatArray, degree: int, order: int, images: int
) -> _Band:
    """Polynomials, or, where that explains more than chance would, polynomials over one that all pairs share.

    With mirror images every line is there twice, and `images` is 2.
    """
    inputs = u.shape[1]
    driving: ComplexArray = np.column_stack([u, np.ones(len(u))])
    table = np.asarray(driving[:, :, None] * _powers(x, degree)[:, None, :]).reshape(len(u), -1)
    free = len(u) - table.shape[1]
    plain = _fitted(table, z)
    poles, left = _common_poles(table, z, x, plain.left, order)
    power = np.sum(np.abs(left) ** 2, axis=0) / free
    fall = 2.0 * float(np.sum(np.sum(np.abs(plain.left) ** 2, axis=0) / power)) - 2.0 * free * z.shape[1]
    has_poles = fall > SHARPER * images
    poles = poles[: order * has_poles]
    fit = _fitted(table / _below(x, poles)[:, None], z)
    for _ in range(STEPS if has_poles else 0):
        own, _ = _by_poles(table, z, x, poles, fit)
        own = own / np.sqrt(power)
        information = np.einsum("lkc,lmc->km", own.conj(), own)
        pull = np.einsum("lkc,lc->k", own.conj(), fit.left / np.sqrt(power))
        step = np.linalg.pinv(information, hermitian=True) @ pull
        closer = _fitted(table / _below(x, poles + step)[:, None], z)
        if not np.linalg.norm(closer.left / np.sqrt(power)) < np.linalg.norm(fit.left / np.sqrt(power)):
            break
        poles, fit = poles + step, closer
    below_nodes = _below(nodes, poles)
    # values at the nodes: of each input its polynomial, nothing of the transient
    told = np.zeros((len(NODES), inputs, inputs + 1, degree + 1), dtype=complex)
    for j in range(inputs):
        told[:, j, j] = _powers(nodes, degree) / below_nodes[:, None]
    told = told.reshape(len(NODES), inputs, -1)
    spread = told @ (fit.inverse @ fit.inverse.conj().T) @ told.conj().transpose(0, 2, 1)
    response = (told @ fit.numbers).transpose(0, 2, 1)
    shared = np.zeros((len(NODES), response[0].size, len(poles)), dtype=complex)
    if has_poles:
        own, taken = _by_poles(table, z, x, poles, fit)
        own = own / np.sqrt(power)
        inverse = np.linalg.pinv(np.einsum("lkc,lmc->km", own.conj(), own), hermitian=True)
        # channels go together, lines do not
        pull = np.einsum("lkc,lc->lk", own.conj(), fit.left / np.sqrt(power))
        meat = pull.T @ pull.conj() * len(u) / free
        values, vectors = np.linalg.eigh(inverse @ meat @ inverse)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        direct = -(_powers(nodes, len(poles))[:, 1:] / below_nodes[:, None])[:, None, None, :] * response[..., None]
        moved = direct - np.einsum("njq,qkc->ncjk", told, taken)
        shared = moved.reshape(len(NODES), -1, len(poles)) @ root
    return _Band(response, spread, shared, fit.left, free - len(poles) / z.shape[1])


def _below(x: FloatArray, poles: ComplexArray) -> ComplexArray:
    """The polynomial under all responses."""
    return np.asarray(1.0 + _powers(x, len(poles))[:, 1:] @ poles)


def _by_poles(
    table: ComplexArray, z: ComplexArray, x: FloatArray, poles: ComplexArray, fit: _Fit
) -> tuple[ComplexArray, ComplexArray]:
    """Derivative of what is fitted by the coefficients below, (lines, orders, channels), and what the numbers take."""
    below = _below(x, poles)
    bent = -(_powers(x, len(poles))[:, 1:] / below[:, None])[:, :, None] * (z - fit.left)[:, None, :]
    taken = np.einsum("ql,lkc->qkc", fit.inverse, bent)
    return bent - np.einsum("lq,qkc->lkc", table / below[:, None], taken), taken


class _Fit(NamedTuple):
    numbers: ComplexArray
    inverse: ComplexArray
    left: ComplexArray


def _fitted(table: ComplexArray, z: ComplexArray) -> _Fit:
    size = np.linalg.norm(table, axis=0)
    inverse = np.linalg.pinv(table / size, rcond=1e-8) / size[:, None]
    numbers = inverse @ z
    return _Fit(numbers, inverse, z - table @ numbers)


def _powers(x: FloatArray, degree: int) -> FloatArray:
    return np.vander(x, degree + 1, increasing=True)


def _common_poles(
    table: ComplexArray, z: ComplexArray, x: FloatArray, left: ComplexArray, order: int
) -> tuple[ComplexArray, ComplexArray]:
    """Coefficients of the polynomial under all responses, from the first power on, and what is left with it.

    Found by linear least squares, again and again, each time weighted by the polynomial found before (Sanathanan and
    Koerner, IEEE Trans. Autom. Control 8 (1963) 56).
    """
    poles, below = np.zeros(order, dtype=complex), np.ones(len(x), dtype=complex)
    for _ in range(ROUNDS):
        noise = np.sqrt(np.mean(np.abs(left) ** 2, axis=0))
        basis, _ = np.linalg.qr(table / below[:, None])
        even = z / below[:, None] / noise
        columns = _powers(x, order)[:, 1:, None] * even[:, None, :]
        columns = columns - np.einsum("lq,qkc->lkc", basis, np.einsum("lq,lkc->qkc", basis.conj(), columns))
        even = even - basis @ (basis.conj().T @ even)
        flat = columns.transpose(0, 2, 1).reshape(-1, order)
        poles = -np.linalg.lstsq(flat, even.ravel(), rcond=1e-10)[0]
        below = _below(x, poles)
        left = _fitted(table / below[:, None], z).left
    return poles, left


def _nodes(count: int) -> NDArray[np.intp]:
    """Which lines of a band are nearest to Gauss's points."""
    return np.rint(0.5 * (count - 1) * (1.0 + NODES)).astype(np.intp)


def _lowest_nodes(count: int) -> NDArray[np.intp]:
    """The same of a band and its mirror image, on its own side."""
    return np.rint(count * MIRRORED).astype(np.intp) - 1


def _noise(bands: list[_Band]) -> tuple[ComplexArray, FloatArray]:
    """Covariance of the noise of every band, (bands, channels, channels), and its spread, (bands,).

    The power of each channel is that of the band, with what of the response is no polynomial; how the channels go
    together is taken from bands around. It is raised by nu / (nu - 1) for the nu degrees of freedom of a power, and by
    n / (n - p + 1) for the n of the correlations of p channels, so that the mean square of what is whitened by it is 1.
    What is whitened by too small a power counts more, and has more noise: on a direction of the response its variance
    is (nu - 1) / (nu - 2) n / (n - p + 1), the same as for powers and matrices of complex Wishart distribution by
    themselves.
    """
    powers, scaled, spreads = [], [], []
    for band in bands:
        power = np.sum(np.abs(band.left) ** 2, axis=0) / band.free
        powers.append(power * band.free / (band.free - 1.0))
        scaled.append(band.left / np.sqrt(np.maximum(power, 1e-300)))
    found = []
    for k, power in enumerate(powers):
        first = min(max(k - AROUND, 0), max(len(bands) - 2 * AROUND - 1, 0))
        near = np.concatenate(scaled[first : first + 2 * AROUND + 1])
        together = near.T @ near.conj()
        size = np.sqrt(np.diag(together).real)
        root = np.sqrt(power)
        free = sum(band.free for band in bands[first : first + 2 * AROUND + 1])
        raised = free / max(free - len(root) + 1.0, 1.0)
        spreads.append(raised * (bands[k].free - 1.0) / (bands[k].free - 2.0))
        found.append(raised * together / np.outer(size, size) * np.outer(root, root))
    return np.array(found), np.array(spreads)
