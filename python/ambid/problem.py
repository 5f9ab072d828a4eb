"""The least-squares problem of closed-loop identification (eq. 9), small whatever the length of the records."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ambid import _core
from ambid.errors import ModelError, UnstableLoopError
from ambid.fit import excitation, measured_outputs, recorded_channels
from ambid.loop.plant import FloatArray
from ambid.model import Model
from ambid.record import Record, noise_ceiling


class Problem:
    """Weighted least squares in relative parameters x = theta / start, reduced to normal equations by the core.

    SciPy sees a residual of `free + 1` numbers with the same norm, Jacobian and gradient as the N x channels one: with
    the eigenvectors ``J'J = V L V'``, they are ``[L^-1/2 V'J'r; what J cannot explain]`` and ``[L^1/2 V'; 0]``.
    """

    def __init__(
        self,
        model: Model,
        records: tuple[Record, ...],
        free: list[int],
        noise: list[FloatArray],
        factors: FloatArray,
        progress: Callable[[int, float], None] | None,
    ) -> None:
        self.model, self.records, self.free = model, records, free
        self.scale = model.theta[free]
        self.factors, self.progress = factors, progress
        self.weights = [
            np.where(np.isin(model.loop.outputs, recorded_channels(record)), factors / rms, 0.0)
            for record, rms in zip(records, noise, strict=True)
        ]
        core = model.loop.core
        self._data = [
            _core.Data(core, excitation(record), measured_outputs(record), w)
            for record, w in zip(records, self.weights, strict=True)
        ]
        self.evaluations = 0
        self._last: tuple[bytes, FloatArray, FloatArray, float] | None = None
        self.best: tuple[float, FloatArray] = (np.inf, self.scale)

    def with_noise(self, noise: list[FloatArray]) -> Problem:
        """The same problem with other noise levels."""
        other = Problem(self.model, self.records, self.free, noise, self.factors, self.progress)
        other.evaluations = self.evaluations
        return other

    def theta(self, x: FloatArray) -> FloatArray:
        """All parameters of the model at x."""
        theta = self.model.theta
        theta[self.free] = x * self.scale
        return theta

    def normal_equations(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """J'J and J'r by x, and r'r."""
        if self._last is None or self._last[0] != x.tobytes():
            core = self.model.loop.core
            hessian, gradient, squares = _core.normal_equations(core, self.theta(x), self.free, self._data)
            cost = float(squares.sum())
            self.evaluations += 1
            self._last = (x.tobytes(), hessian * np.outer(self.scale, self.scale), gradient * self.scale, cost)
            if cost < self.best[0]:
                self.best = (cost, x.copy())
            if self.progress is not None:
                self.progress(self.evaluations, cost)
        return self._last[1:]

    def residual(self, x: FloatArray) -> FloatArray:
        """The short residual; infinite, which SciPy rejects as a step, where the loop is unstable."""
        try:
            return self._short(x)[0]
        except (UnstableLoopError, ModelError):
            return np.full(len(x) + 1, np.inf)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """The short Jacobian that belongs to `residual`."""
        return self._short(x)[1]

    def _short(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        hessian, gradient, cost = self.normal_equations(x)
        values, vectors = np.linalg.eigh(hessian)
        roots = np.sqrt(np.maximum(values, values[-1] * 1e-15))
        explained = vectors.T @ gradient / roots
        rest = np.sqrt(max(cost - explained @ explained, 0.0))
        return np.append(explained, rest), np.vstack([roots[:, None] * vectors.T, np.zeros(len(x))])

    def residual_rms(self, theta: FloatArray) -> list[FloatArray]:
        """Rms of each channel's residual, per record."""
        found = []
        for record in self.records:
            z = measured_outputs(record)
            rms = (z - self.model.loop.simulate(theta, excitation(record))).std(axis=0)
            found.append(np.where(rms > 0.0, rms, 1.0))
        return found


def noise_levels(records: Sequence[Record]) -> list[FloatArray]:
    """Noise rms of each output, from the scatter over the periods; without periods, the signal's own rms."""
    levels = []
    for record in records:
        ceilings = noise_ceiling(record)
        deviation = measured_outputs(record).std(axis=0)
        share = np.array([1.0 - ceilings.get(name, np.nan) / 100.0 for name in recorded_channels(record)])
        share = np.append(share, np.ones(len(deviation) - len(share)))
        rms = np.where(np.isnan(share), 1.0, share) * deviation
        levels.append(np.where(rms > 0.0, rms, 1.0))
    return levels
