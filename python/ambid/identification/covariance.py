"""Covariance of the estimate: by the noise on lines, and, where misfit is left, by what is left.

Where the model is right, the inverse of J'J is the covariance of the parameters, but for the spread that the estimated
noise spectrum adds (`Spectrum.spread`). Where misfit is left it is not: what is missing stands in the residual with
the same sign on many neighbouring lines. The score of each line, g_l = J_l' r_l, is then summed over bands of lines,
and

    cov(theta) = H^-1 (sum over bands of g g') H^-1 n / (n - q)

(White 1980; Liang and Zeger 1986 for groups), n bands and q parameters, never less than J/dof times the first. It
allows for misfit whose parts in different bands are independent, not for one that bends all bands alike.

The weights of eq. 9 know no lines. Sensor noise goes round the loop, so that the residual r is coloured and its
channels are correlated; the textbook ``sigma^2 (J'J)^-1`` is then wrong. With H = J'WJ and the score s = J'Wr,

    cov(theta) = H^-1 cov(s) H^-1,    cov(s) = 1/N sum_f  J_f^H W S_f W J_f,

S_f being the cross-spectrum of the residual, J_f the discrete Fourier transform of the Jacobian (Ljung, System
Identification, 2nd ed., section 9.5). S_f is a mean over neighbouring lines; since a bending mode is narrower than
that, the residual is first taken back through the loop, where its noise is smooth.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import FloatArray
from ambid.identification.problem import Problem, padded
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.colour import loop_noise
from ambid.noise.known import BANDS, known_weights

UNSEEN_VARIANCE = 1e6
"""Relative variance that stands for infinity, for a combination that moves no output."""

BAND = 21
"""Neighbouring lines over which the spectrum of the residual is averaged."""


def covariance(comparison: Comparison, free: Sequence[int]) -> FloatArray:
    """Covariance of the free parameters of a model at the minimum of J, shape (free, free).

    Combinations that move no output have a variance that stands for infinity.
    """
    scale = sizes(comparison.model, free)
    inverse, unseen, by_noise = _by_noise(comparison, free, scale)
    by_known = inverse * (known_weights(comparison.model, free) * scale**2) @ inverse
    relative = by_noise + by_known + UNSEEN_VARIANCE * unseen @ unseen.T
    return np.asarray(relative * np.outer(scale, scale))


def budget(comparison: Comparison, free: Sequence[int]) -> FloatArray:
    """Variance of each free parameter by what it comes from, shape (free, 1 + free).

    The first column is that of noise and misfit (statistical, type A of the GUM, JCGM 100:2008); the others are those
    of the tolerance to which each free parameter is known beforehand, 0 for one that is not. Rows sum to the variances
    of `covariance`, where the records determine all.
    """
    scale = sizes(comparison.model, free)
    inverse, _, by_noise = _by_noise(comparison, free, scale)
    by_known = inverse**2 * (known_weights(comparison.model, free) * scale**2)
    return np.asarray(np.hstack([np.diag(by_noise)[:, None], by_known]) * scale[:, None] ** 2)


def _by_noise(
    comparison: Comparison, free: Sequence[int], scale: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inverse of half the Hessian of J, the directions that move no output, and the covariance by noise and misfit.

    Beside what is known beforehand, residuals that are larger than noise count as little as in the fit, see `tempered`.
    """
    hessian = comparison.noise.quadratic(comparison.model, free).hessian * np.outer(scale, scale)
    known = known_weights(comparison.model, free) * scale**2
    left = 1.0
    if known.any() and not comparison.is_adequate:
        left = comparison.noise.size.variance(comparison.cost)
        hessian = hessian / left + np.diag((1.0 - 1.0 / left) * known)
    inverse, unseen = inverted(hessian)
    by_noise = inverse * float(np.mean(comparison.noise.spreads))
    if known.any():  # what is known beforehand is no part of what the records measure
        values, vectors = np.linalg.eigh(hessian - np.diag(known))
        root = inverse @ vectors * np.sqrt(np.maximum(values, 0.0))
        by_noise = root @ root.T * float(np.mean(comparison.noise.spreads))
    if not comparison.is_adequate:
        banded = inverse @ (_banded(comparison, free, scale) / left**2) @ inverse
        by_noise = _larger(banded, by_noise * (comparison.misfit / left))
    return inverse, unseen, by_noise


def sizes(model: Model, free: Sequence[int]) -> FloatArray:
    """What is large for each parameter, shape (free,)."""
    return np.array([model.parameters[i].scale for i in free])


def sandwich(problem: Problem, theta: FloatArray) -> FloatArray:
    """Covariance of the free parameters at the minimum of eq. 9, shape (free, free)."""
    size = len(problem.free)
    at_end = problem.model.with_theta(theta)
    hessian, score = np.zeros((size, size)), np.zeros((size, size))
    for record, weight in zip(problem.records, problem.weights, strict=True):
        y, jacobian = at_end.sensitivity(record, problem.free)
        used = weight > 0.0
        residual = (padded(at_end, record, record.outputs) - y)[:, used] * weight[used]
        jacobian = jacobian[:, used] * (weight[used, None] * problem.scale)
        residual -= residual.mean(axis=0)
        jacobian -= jacobian.mean(axis=0)
        lines = jacobian.reshape(-1, size)
        hessian += lines.T @ lines
        points = np.exp(2j * np.pi * np.arange(1, record.samples // 2 + 1) / record.samples)
        way = loop_noise(at_end.at(record), points, len(weight))
        way = np.concatenate([np.eye(len(weight))[None], way])  # means are removed
        score += score_covariance(residual, jacobian, way[:, used][:, :, used] * weight[used, None])
    # where no output moves, the score does not scatter either, and the sandwich alone would claim perfect knowledge
    inverse, unseen = inverted(hessian)
    relative = inverse @ score @ inverse + UNSEEN_VARIANCE * unseen @ unseen.T
    return np.asarray(relative * np.outer(problem.scale, problem.scale))


def propagated(problem: Problem, theta: FloatArray, statistical: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Covariance of a minimum of eq. 9 and its parts, where the last free parameters are known to a tolerance.

    An error of such a value moves the minimum by ``-H^-1 H_known``; its variance is propagated (GUM, JCGM 100:2008, 5).

    Parameters
    ----------
    problem : Problem
        With m parameters and k values that are known.
    theta : ndarray
        All parameters.
    statistical : ndarray, shape (m, m)
        Covariance by noise.

    Returns
    -------
    (m + k, m + k) ndarray
        Of all.
    (m + k, 1 + m + k) ndarray
        As of `budget`.
    """
    size, total = len(statistical), len(problem.free)
    spread = np.array([problem.model.parameters[i].prior or 0.0 for i in problem.free[size:]])
    moves = np.vstack([np.zeros((size, total - size)), np.eye(total - size)])
    if total > size:
        hessian = problem.normal_equations(theta[problem.free] / problem.scale)[0]
        slopes = -inverted(hessian[:size, :size])[0] @ hessian[:size, size:]
        moves[:size] = slopes * problem.scale[:size, None] / problem.scale[size:]
    by_noise = np.pad(statistical, (0, total - size))
    parts = np.hstack([np.diag(by_noise)[:, None], np.zeros((total, size)), (moves * spread) ** 2])
    return by_noise + (moves * spread**2) @ moves.T, parts


def of_hessian(problem: Problem, theta: FloatArray) -> FloatArray:
    """Covariance of the free parameters where residuals are white noise of the size that they are weighed with."""
    inverse, unseen = inverted(problem.normal_equations(theta[problem.free] / problem.scale)[0])
    relative = inverse + UNSEEN_VARIANCE * unseen @ unseen.T
    return np.asarray(relative * np.outer(problem.scale, problem.scale))


def inverted(hessian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverse in the directions that move the outputs, and the directions that do not, shape (free, unseen)."""
    values, vectors = np.linalg.eigh(hessian)
    seen = values > values[-1] * 1e-13
    return (vectors[:, seen] / values[seen]) @ vectors[:, seen].T, vectors[:, ~seen]


def _larger(a: FloatArray, b: FloatArray) -> FloatArray:
    """The smallest covariance of this kind that is not below either: b, and what a has beyond it."""
    if not b.any():  # nothing moves any output
        return a
    root = np.linalg.cholesky(b + 1e-14 * np.trace(b) * np.eye(len(b)))
    inner = np.linalg.solve(root, np.linalg.solve(root, a).T)
    values, vectors = np.linalg.eigh(inner)
    turned = root @ vectors
    return np.asarray((turned * np.maximum(values, 1.0)) @ turned.T)


def _banded(comparison: Comparison, free: Sequence[int], scale: FloatArray) -> FloatArray:
    """Sum of g g' over bands of lines, by the scaled parameters."""
    residual, columns = comparison.noise.jacobian(comparison.model, free)
    total, bands = np.zeros((len(free), len(free))), 0
    start = 0
    for part in comparison.noise.parts:
        own = slice(start, start + part.numbers)
        start += part.numbers
        scores = part.by_line(columns[own] * scale * residual[own, None])
        for band in np.array_split(scores, min(BANDS, len(scores))):
            g = band.sum(axis=0)
            total += np.outer(g, g)
            bands += 1
    fitted = int(np.count_nonzero(known_weights(comparison.model, free) == 0.0))
    return np.asarray(total * bands / max(bands - fitted, 1))


def score_covariance(residual: FloatArray, jacobian: FloatArray, way: NDArray[np.complex128]) -> FloatArray:
    """Covariance of ``J' r`` for one record whose residual is stationary noise of unknown colour.

    Parameters
    ----------
    residual : ndarray, shape (N, channels)
        Weighted, without means.
    jacobian : ndarray, shape (N, channels, parameters)
        Weighted, without means.
    way : ndarray, shape (N / 2 + 1, channels, channels)
        From noise that is smooth over frequency to the weighted channels, see `loop_noise`.

    Returns
    -------
    ndarray, shape (parameters, parameters)
    """
    samples, _, parameters = jacobian.shape
    lines = samples // 2 + 1
    smooth = _in_bands(np.linalg.solve(way, rfft(residual, axis=0)[..., None])[..., 0])
    j = _in_bands(way.conj().transpose(0, 2, 1) @ rfft(jacobian, axis=0))
    sides = np.full(lines, 2.0)  # negative frequencies
    sides[0] = 1.0
    if samples % 2 == 0:
        sides[-1] = 1.0
    used = _in_bands(np.ones(lines)).sum(axis=1)
    spectrum = smooth.transpose(0, 2, 1) @ smooth.conj() / (samples * used[:, None, None])  # E[R_c conj(R_d)]
    filtered = spectrum[:, None] @ j
    weighted = (_in_bands(sides)[:, :, None, None] * filtered).reshape(-1, parameters)
    return (j.reshape(-1, parameters).conj().T @ weighted).real / samples


def _in_bands(lines: NDArray[Any]) -> NDArray[Any]:
    """Lines (n, ...) as (bands, BAND, ...), filled up with zeros."""
    fill = -len(lines) % BAND
    padded = np.concatenate([lines, np.zeros((fill, *lines.shape[1:]), lines.dtype)])
    return padded.reshape(-1, BAND, *lines.shape[1:])
