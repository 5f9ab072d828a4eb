"""The smooth shape of noise over frequency: an autoregressive spectrum of each channel, fitted to its lines.

What is divided by it is flat enough to be averaged over many lines (prewhitening; Percival and Walden, Spectral
Analysis for Physical Applications, 1993, section 6.5).
"""

import numpy as np

from ambid.arrays import FloatArray

HIGHEST = 24
"""Order of an autoregressive spectrum, at the most."""


class Envelope:
    """Autoregressive spectra of single channels, each of the order that Schwarz's criterion prefers.

    Parameters
    ----------
    power : ndarray, shape (lines, p)
        Of every line.
    angle : ndarray, shape (lines,)
        Their frequency, evenly over 0 .. pi [rad/sample].

    Attributes
    ----------
    orders : ndarray of int, shape (p,)
    """

    def __init__(self, power: FloatArray, angle: FloatArray) -> None:
        self._angle = angle
        count, p = power.shape
        highest = max(0, min(HIGHEST, count // 10))  # so many lines, at the least, for every coefficient
        moments = _moments(power, np.cos(angle), highest) / count
        self._coefficients = np.zeros((highest + 1, p))
        self._coefficients[0] = 1.0
        self._innovation = moments[0].copy()
        self.orders = np.zeros(p, dtype=np.intp)
        # of complex lines the logarithm of the likelihood is -count log(power), but for a constant
        best = 2.0 * count * np.log(np.maximum(moments[0], 1e-300))
        a, left = self._coefficients.copy(), moments[0].copy()
        for order in range(1, highest + 1):  # Levinson's recursion, all channels at once
            reflection = -np.einsum("kc,kc->c", a[:order], moments[order:0:-1]) / np.maximum(left, 1e-300)
            # part of the power that coefficients may leave: of less the recursion has lost its digits, and would leave
            # a negative power
            known = left * (1.0 - reflection**2) > 1e-10 * moments[0]
            reflection = np.where(known, reflection, 0.0)
            a[: order + 1] += reflection * a[order::-1]
            left = left * (1.0 - reflection**2)
            criterion = 2.0 * count * np.log(np.maximum(left, 1e-300)) + order * np.log(count)
            better = criterion < best
            best = np.where(better, criterion, best)
            self._coefficients[:, better] = a[:, better]
            self._innovation = np.where(better, left, self._innovation)
            self.orders[better] = order

    def root(self, angle: FloatArray) -> FloatArray:
        """Root of the spectra at frequencies, shape (lines, p)."""
        turn, whole = np.exp(-1j * angle)[:, None], np.zeros((len(angle), len(self.orders)), dtype=complex)
        for own in self._coefficients[self.orders.max(initial=0) :: -1]:
            whole = whole * turn + own
        return np.asarray(np.sqrt(self._innovation) / np.abs(whole))

    def variance(self, angle: FloatArray) -> FloatArray:
        """Of the logarithm of the spectra at frequencies, since the coefficients were fitted, shape (lines, p)."""
        found = np.zeros((len(angle), len(self.orders)))
        for channel, order in enumerate(self.orders):
            slopes, fitted = (self._slopes(at, channel, int(order)) for at in (angle, self._angle))
            found[:, channel] = np.einsum("la,ab,lb->l", slopes, np.linalg.pinv(fitted.T @ fitted), slopes)
        return found

    def _slopes(self, angle: FloatArray, channel: int, order: int) -> FloatArray:
        """Derivatives of the logarithm of a spectrum by its coefficients."""
        turns = np.exp(-1j * np.arange(order + 1)[:, None] * angle)
        whole = turns.T @ self._coefficients[: order + 1, channel]
        return np.column_stack([np.ones(len(angle)), *(-2.0 * (turns[1:] / whole).real)])


def _moments(power: FloatArray, cosine: FloatArray, highest: int) -> FloatArray:
    """Sums of powers times the cosines of the multiples of their angles, from none to the highest."""
    found, before, here = np.empty((highest + 1, power.shape[1])), cosine, np.ones(len(cosine))
    for k in range(highest + 1):
        found[k] = here @ power
        before, here = here, 2.0 * cosine * here - before
    return found
