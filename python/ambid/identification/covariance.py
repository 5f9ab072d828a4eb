"""Covariance of the estimate although the residual is coloured by the loop: the sandwich in the frequency domain.

Sensor noise goes round the loop, so that the residual r is coloured and its channels are correlated; the textbook
``sigma^2 (J'J)^-1`` is then wrong. With H = J'WJ and the score s = J'Wr,

    cov(theta) = H^-1 cov(s) H^-1,    cov(s) = 1/N sum_f  J_f^H W S_f W J_f,

S_f being the cross-spectrum of the residual, J_f the discrete Fourier transform of the Jacobian (Ljung, System
Identification, 2nd ed., section 9.5; White 1980 for the sandwich). S_f is a mean over neighbouring lines; since a
bending mode is narrower than that, the residual is first taken back through the loop, where its noise is smooth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from ambid.arrays import FloatArray

BAND = 21
"""Neighbouring lines over which the spectrum of the residual is averaged."""


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
