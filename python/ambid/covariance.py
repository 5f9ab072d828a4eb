"""Covariance of the estimate although the residual is coloured by the loop: the sandwich in the frequency domain.

Sensor noise goes round the loop, so that the residual r is coloured and its channels are correlated; the textbook
``sigma^2 (J'J)^-1`` is then wrong. With H = J'WJ and the score s = J'Wr,

    cov(theta) = H^-1 cov(s) H^-1,    cov(s) = 1/N sum_f  J_f^H W S_f W J_f,

S_f being the cross-spectrum of the residual, J_f the discrete Fourier transform of the Jacobian (Ljung, System
Identification, 2nd ed., section 9.5; White 1980 for the sandwich).
"""

from __future__ import annotations

import numpy as np
from scipy.fft import rfft
from scipy.ndimage import uniform_filter1d

from ambid.loop.assembly import FloatArray

HALF_WIDTH = 10
"""The spectrum of the residual is averaged over this many lines to each side."""


def score_covariance(residual: FloatArray, jacobian: FloatArray) -> FloatArray:
    """Covariance of ``J' r`` for one record whose residual is stationary noise of unknown colour.

    Parameters
    ----------
    residual : ndarray, shape (N, channels)
        Weighted, without means.
    jacobian : ndarray, shape (N, channels, parameters)
        Weighted, without means.

    Returns
    -------
    ndarray, shape (parameters, parameters)
    """
    samples = len(residual)
    r = rfft(residual, axis=0)
    j = rfft(jacobian, axis=0)
    spectrum = np.einsum("fc,fd->fcd", r, r.conj()) / samples
    width = 2 * HALF_WIDTH + 1
    spectrum = uniform_filter1d(spectrum.real, width, axis=0, mode="mirror") + 1j * uniform_filter1d(
        spectrum.imag, width, axis=0, mode="mirror"
    )
    sides = np.full(len(r), 2.0)  # negative frequencies
    sides[0] = 1.0
    if samples % 2 == 0:
        sides[-1] = 1.0
    filtered = np.einsum("fcd,fdp->fcp", spectrum, j) * sides[:, None, None]
    lines = j.reshape(-1, j.shape[2])
    return (lines.conj().T @ filtered.reshape(-1, j.shape[2])).real / samples
