"""What uncertain parameters do to the peaks of the sensitivity: draws, slopes, and the worst of the 95 % ellipsoid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from ambid.arrays import FloatArray
from ambid.errors import ModelError
from ambid.model import Model
from ambid.robustness.peaks import find_peaks, gains, peaks_of, slopes_of
from ambid.robustness.sensitivity import BrokenLoop

COVERED = 0.95
"""Probability of the ellipsoid, and of the intervals."""
FEWEST_ALLOWED = 0.5
"""Part of the draws that must be what physics allows: else the covariance does not describe the parameters."""


@dataclass(frozen=True)
class Uncertainty:
    """Free parameters and a square root of their covariance.

    Attributes
    ----------
    theta : ndarray, shape (parameters,)
        The values of all.
    free : tuple of int
        Indices of those that are uncertain.
    root : ndarray, shape (free, free)
        ``root root'`` is the covariance.
    lower, upper : ndarray, shape (parameters,)
        What physics allows.
    """

    theta: FloatArray
    free: tuple[int, ...]
    root: FloatArray
    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, model: Model) -> Uncertainty | None:
        """Of a model; None where it has no covariance."""
        if model.covariance is None:
            return None
        free = tuple(np.flatnonzero(np.isfinite(np.diag(model.covariance))).tolist())
        if not free:
            return None
        own = model.covariance[np.ix_(free, free)]
        scale = np.sqrt(np.diag(own))
        scale[scale == 0.0] = 1.0
        values, vectors = np.linalg.eigh(own / np.outer(scale, scale))
        root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        limits = np.array([(p.lower, p.upper) for p in model.parameters]).T
        return cls(model.theta, free, root, *limits)

    @property
    def radius(self) -> float:
        """Of the 95 % ellipsoid, in the coordinates of `at`."""
        return float(np.sqrt(chdtri(len(self.free), 1.0 - COVERED)))

    def towards(self, slope: FloatArray) -> FloatArray:
        """Where the 95 % ellipsoid ends along a slope; the middle where there is none."""
        size = np.linalg.norm(slope)
        return self.radius * slope / size if size > 0.0 else slope

    def at(self, z: FloatArray) -> FloatArray:
        """Values of all parameters, shape (..., parameters), at points of the unit normal distribution."""
        theta = np.broadcast_to(self.theta, (*z.shape[:-1], len(self.theta))).copy()
        theta[..., list(self.free)] += z @ self.root.T
        return theta

    def allows(self, theta: FloatArray) -> bool:
        """Whether physics allows these values."""
        return bool(np.all((theta >= self.lower) & (theta <= self.upper)))


@dataclass(frozen=True)
class Draws:
    """Peaks at draws of the parameters.

    Attributes
    ----------
    z : ndarray, shape (draws, free)
        Where they were drawn, see `Uncertainty.at`.
    peaks : ndarray, shape (draws, gains)
        Infinite where the loop is unstable.
    curves : ndarray, shape (stable draws, F, axes)
        ``|S_jj|`` over frequency.
    outside : int
        Draws that were left out since physics does not allow them.
    """

    z: FloatArray
    peaks: FloatArray
    curves: FloatArray
    outside: int

    @property
    def unstable(self) -> int:
        """Draws with an unstable loop."""
        return int(np.sum(np.isinf(self.peaks[:, 0])))

    def interval(self, gain: int) -> tuple[float, float]:
        """Of a gain, with 95 %; infinite at its end where many draws are unstable."""
        tail = 0.5 * (1.0 - COVERED)
        low, high = np.quantile(self.peaks[:, gain], (tail, 1.0 - tail), method="inverted_cdf")
        return float(low), float(high)


def drawn(
    loop: BrokenLoop,
    uncertainty: Uncertainty,
    count: int,
    seed: int,
    frequency_hz: FloatArray,
    progress: Callable[[int, int], None],
) -> Draws:
    """Draw parameters from their normal distribution, and find the peaks of each loop.

    Raises
    ------
    ModelError
        If most draws are not what physics allows.
    """
    z = np.random.default_rng(seed).standard_normal((count, len(uncertainty.free)))
    allowed = np.array([uncertainty.allows(theta) for theta in uncertainty.at(z)])
    if allowed.mean() < FEWEST_ALLOWED:
        where = loop.model.rig.path or loop.model.rig.name
        raise ModelError(
            f"{where}: {count - allowed.sum()} of {count} draws from the covariance have values that physics does not "
            "allow; the records determine the parameters too poorly: excite more, or longer, and identify again"
        )
    z = z[allowed]
    peaks, curves = np.full((len(z), 2 * loop.axes + 2), np.inf), []
    for k, theta in enumerate(uncertainty.at(z)):
        progress(k, len(z))
        if is_stable(loop, theta):
            peaks[k], curve = _peaks_and_curve(loop, theta, frequency_hz)
            curves.append(curve)
    return Draws(z, peaks, np.array(curves), int(np.sum(~allowed)))


def _peaks_and_curve(loop: BrokenLoop, theta: FloatArray, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Peaks, and ``|S_jj|`` at given frequencies, from one grid."""
    grid = np.union1d(frequency_hz, loop.grid(theta))
    values = gains(loop.sensitivity(theta, grid))
    found = find_peaks(lambda f: loop.sensitivity(theta, f), grid, values, rounds=3)  # they are found to 1e-5
    return found.values, values[np.searchsorted(grid, frequency_hz), : loop.axes]


def is_stable(loop: BrokenLoop, theta: FloatArray) -> bool:
    """Whether every pole decays."""
    return bool(loop.model.loop.poles(theta).real.max() < 0.0)


def worst_of_ellipsoid(
    loop: BrokenLoop, uncertainty: Uncertainty, gain: int, starts: Sequence[FloatArray]
) -> tuple[float, FloatArray]:
    """The largest value of a gain's peak within the 95 % ellipsoid, and the parameters there.

    From each start the way goes along the slope to the ellipsoid's surface, again and again; what grows bent upwards,
    as a peak does towards instability, is largest there. Values that physics forbids are not entered.

    Returns
    -------
    value : float
        Infinite where the ellipsoid reaches an unstable loop.
    theta : ndarray, shape (parameters,)
    """
    best, at = -np.inf, uncertainty.theta
    for start in starts:
        z = start
        value = -np.inf
        for _ in range(12):
            theta = uncertainty.at(z)
            if not uncertainty.allows(theta):
                break
            if not is_stable(loop, theta):
                return np.inf, theta
            peaks = peaks_of(loop, theta)
            if peaks.values[gain] > best:
                best, at = float(peaks.values[gain]), theta
            # relative growth of a peak in a step below which the way ends
            if peaks.values[gain] <= value * 1.000001:
                break
            value = float(peaks.values[gain])
            slope = slopes_of(loop, theta, peaks, uncertainty.free)[gain] @ uncertainty.root
            z = uncertainty.towards(slope)
    return best, at
