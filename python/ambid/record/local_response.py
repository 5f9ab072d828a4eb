"""The frequency response of a record in time, by local polynomials over neighbouring lines.

On the lines l of the discrete Fourier transform of a stretch of a record,

    Z(l) = H(l) U(l) + T(l) + noise,

the response H and the transient T are smooth over frequency, while the excitations U of several axes, of different
sequences, are not: over a few neighbouring lines both are polynomials of degree three, which least squares separate
(Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapter 7). Near a pole they are
such polynomials over another one, which all of them share, since they have the poles of one loop (McKelvey and Guerin,
16th IFAC Symposium on System Identification, 2012); its errors are in the covariance. Bands do not overlap.
In each H is given at the lines next to the four points of Gauss's quadrature, where the errors of a cubic are
independent of each other if the lines are excited alike: so all that the band shows of H is given, and nothing twice.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import RecordError
from ambid.record.frequency_response import FrequencyResponse
from ambid.record.local_bands import DEGREE, FREE, NODES, Bands, fitted_bands, lowest_band, lowest_nodes, nodes
from ambid.record.rounding import rounding_power

AROUND = 3
"""Bands to each side that the correlation of the channels is taken from."""


OVER_ROUNDING = 30.0
"""Power of an axis on a line over that of the rounding to its steps, below which it may be rounding: by chance one line
in 1e13 has as much."""


class LocalResponse(NamedTuple):
    """The estimates of local polynomials.

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


def response_of_signals(
    where: str,
    moving: Mapping[str, FloatArray],
    axes: Sequence[str],
    outputs: FloatArray,
    channels: Sequence[str],
    *,
    sample_rate: float,
    period: int | None,
) -> FrequencyResponse:
    """The response from the signals that drive a loop, i_e, r or both, to its channels, by their names.

    Signals of several units are scaled to each other first. Parameters and errors are those of `local_response`.
    """
    sizes = np.repeat([1.0 if len(moving) == 1 else own.std() for own in moving.values()], len(axes))
    found = local_response(where, np.hstack(list(moving.values())) / sizes, outputs, sample_rate, period)
    names = [f"{signal}.{axis}" for signal in moving for axis in axes]
    sizes = sizes[found.excited]
    of_pairs = np.tile(sizes, len(channels))
    covariance = found.covariance
    covariance /= np.outer(of_pairs, of_pairs)
    covariance.flags.writeable = False  # of a long record it is large, and need not be copied
    return FrequencyResponse.from_arrays(
        found.frequency_hz,
        found.response / sizes,
        outputs=channels,
        inputs=[name for name, is_excited in zip(names, found.excited, strict=True) if is_excited],
        covariance=covariance,
        spread=found.spread,
        name=where,
    )


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
        If there are too few lines, or too few in every band are excited: what unexcited ones would show is left out.
    """
    power = np.var(drives, axis=0)
    # power of an axis over that of the loudest below which it is not excited
    excited = power > 1e-6 * power.max(initial=0.0)
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
    length, longer = divmod(len(index), count)
    split = longer * (length + 1)  # so many lines are in bands that are longer by one
    lowest = length + (longer > 0)
    rounding = periods * np.array([rounding_power(own) for own in drives[:, excited].T])
    # power of an axis on a line over that on its loudest below which it is rounding, as of a converter of 16 bits
    moving = np.abs(u) ** 2 > np.maximum(1e-10 * (np.abs(u) ** 2).max(axis=0), OVER_ROUNDING * rounding)
    groups, places = [lowest_band(u[:lowest], z[:lowest])], [index[lowest_nodes(lowest)]]
    known = [_is_known(moving[None, :lowest], lowest_nodes(lowest))]
    for rows, size in ((np.arange(lowest, split), length + 1), (np.arange(max(split, lowest), len(index)), length)):
        if len(rows):
            own = rows.reshape(-1, size)
            groups.append(fitted_bands(u[own], z[own]))
            places.append(index[own[:, nodes(size)]].ravel())
            known.append(_is_known(moving[own], nodes(size)))
    contributing = np.concatenate(known)
    if not contributing.any():
        raise RecordError(
            f"{where}: no {width} neighbouring lines of which {DEGREE + 1} or more are excited on every axis; excite "
            "more lines, or hold the model against the record itself"
        )
    response = np.concatenate([bands.response for bands in groups]).reshape(-1, z.shape[1], u.shape[1])
    noise, spreads = noise_of(groups)
    covariance = _covariance(groups, noise)
    frequency_hz = np.concatenate(places) * sample_rate / samples
    return LocalResponse(
        frequency_hz[contributing], response[contributing], covariance[contributing], float(np.mean(spreads)), excited
    )


def _covariance(groups: Sequence[Bands], noise: ComplexArray) -> ComplexArray:
    """Of the errors of all pairs at every node, (bands * nodes, pairs, pairs)."""
    count, channels, inputs = len(noise), noise.shape[1], groups[0].spread.shape[2]
    pairs = channels * inputs
    found = np.empty((count * len(NODES), pairs, pairs), dtype=complex)
    apart = found.reshape(count, len(NODES), channels, inputs, channels, inputs)
    first = 0
    for bands in groups:
        end = first + len(bands.free)
        spread = bands.spread[:, :, None, :, None, :]
        np.multiply(noise[first:end, None, :, None, :, None], spread, out=apart[first:end])
        for k, shared in bands.shared.items():
            rows = slice((first + k) * len(NODES), (first + k + 1) * len(NODES))
            found[rows] += shared @ shared.conj().transpose(0, 2, 1)
        first = end
    return found


def noise_of(groups: Sequence[Bands]) -> tuple[ComplexArray, FloatArray]:
    """Covariance of the noise of every band, (bands, channels, channels), and its spread, (bands,).

    The power of each channel is that of the band, with what of the response is no polynomial; how the channels go
    together is taken from bands around. It is raised by nu / (nu - 1) for the nu degrees of freedom of a power, and by
    n / (n - p + 1) for the n of the correlations of p channels, so that the mean square of what is whitened by it is 1.
    What is whitened by too small a power counts more, and has more noise: on a direction of the response its variance
    is (nu - 1) / (nu - 2) n / (n - p + 1), the same as for powers and matrices of complex Wishart distribution by
    themselves.
    """
    powers, products = [], []
    for bands in groups:
        power = np.sum(np.abs(bands.left) ** 2, axis=1) / bands.free[:, None]
        scaled = bands.left / np.sqrt(np.maximum(power, 1e-300))[:, None]
        powers.append(power * (bands.free / (bands.free - 1.0))[:, None])
        products.append(scaled.swapaxes(1, 2) @ scaled.conj())
    root, product = np.sqrt(np.concatenate(powers)), np.concatenate(products)
    free, channels = np.concatenate([bands.free for bands in groups]), root.shape[1]
    near = min(2 * AROUND + 1, len(free))
    first = np.clip(np.arange(len(free)) - AROUND, 0, len(free) - near)
    together = sum(product[first + k] for k in range(near))
    size = np.sqrt(np.diagonal(together, axis1=1, axis2=2).real)
    degrees = np.sum([free[first + k] for k in range(near)], axis=0)
    raised = degrees / np.maximum(degrees - channels + 1.0, 1.0)
    scale = root / size
    covariance = raised[:, None, None] * together * scale[:, :, None] * scale[:, None, :]
    return np.asarray(covariance), np.asarray(raised * (free - 1.0) / (free - 2.0))


def _is_known(moving: NDArray[np.bool_], at: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which points of bands (bands, lines, axes) determine H: each axis moves lines enough, and on both sides."""
    below, above = (np.logical_or.accumulate(own, axis=1) for own in (moving, moving[:, ::-1]))
    between = (below & above[:, ::-1])[:, at]
    enough = moving.sum(axis=1)[:, None] > DEGREE
    return np.asarray((between & enough).all(axis=2).ravel())
