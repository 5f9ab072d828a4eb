"""The least-squares problem of closed-loop identification (eq. 9), small whatever the length of the records."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.optimize import least_squares

from ambid import _core
from ambid.arrays import FloatArray
from ambid.errors import ModelError, UnstableLoopError
from ambid.model import Model
from ambid.noise import noise_ceiling
from ambid.noise.known import Size, tempered, tempered_cost
from ambid.record import Record

T = TypeVar("T")

EXACTLY, CLOSELY = 1e-8, 1e-5
"""Relative step at which a descent ends, and one whose end moves no more than a small part of a standard error."""
ENOUGH = 1e-3
"""Fall of J, in units of noise, that moves no parameter by more than 3 % of its standard error: below it there is
nothing to be gained where values are known to a tolerance, whose derivatives make an evaluation costly."""


ROUGHLY, NEAR, UPHILL = 1e-4, 0.1, 2
"""Of a fit that is judged among others: relative step at which it ends, fall of J that distinguishes none, and how many
steps in a row may lead uphill, each a quarter of the one before."""
UNDERSTATED = 4.0
"""Factor by which the fall of J may err that a straight line, or the parabola of a place, promises."""


class End(NamedTuple):
    """Where a descent ended: all parameters, cost, and a status of `estimate.STATUS`."""

    theta: FloatArray
    cost: float
    status: str


class _Arrived(Exception):
    """What is left to gain is less than a descent looks for."""

    def __init__(self, end: End) -> None:
        super().__init__()
        self.end = end


Limits = tuple[FloatArray, FloatArray]


class Descent(NamedTuple):
    """A way downhill that is to be gone, from x."""

    problem: LeastSquares
    x: FloatArray
    limits: Limits
    most: int
    step: float = EXACTLY

    def alone(self) -> End:
        """Go it."""
        return self.problem.descend(self.x, self.limits, self.most, self.step)


class LeastSquares(ABC):
    """Least squares in scaled parameters x = theta / scale, reduced to normal equations.

    SciPy sees a residual of `free + 1` numbers with the same norm, Jacobian and gradient as the N x channels one: with
    the eigenvectors ``J'J = V L V'``, they are ``[L^-1/2 V'J'r; what J cannot explain]`` and ``[L^1/2 V'; 0]``.
    """

    def __init__(self, model: Model, free: list[int], progress: Callable[[int, float], None] | None) -> None:
        self.model, self.free, self.progress = model, free, progress
        self.scale = np.array([model.parameters[i].scale for i in free])
        self.evaluations = 0
        self._best: tuple[float, FloatArray] = (np.inf, self.scale)
        self._gain, self._least, self._most_uphill, self._uphill, self._bound = 0.0, 0.0, np.inf, 0, np.inf
        self._last: tuple[bytes, FloatArray, FloatArray, float] | None = None

    @abstractmethod
    def _evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """J'J and J'r by the free parameters, and r'r, r being simulated minus measured."""

    @property
    def is_approximate(self) -> bool:
        """Whether derivatives are near enough to lead downhill, but not to end where J is least to the last digit."""
        return False

    def _cost_alone(self, theta: FloatArray) -> float | None:
        """r'r, where that is had for much less than with its derivatives; else None."""
        return None

    @property
    def prior(self) -> FloatArray:
        """One over the variance to which each free parameter is known beforehand, shape (free,); 0 of none."""
        return np.zeros(len(self.free))

    @property
    def enough(self) -> float:
        """Fall of J below which no further step is gone; 0 where the relative step alone ends a descent."""
        return ENOUGH if self.prior.any() else 0.0

    @property
    def size(self) -> Size:
        """Of what is judged, where something is known beforehand; see `tempered`."""
        return Size()

    def for_core(self) -> _core.Records | None:
        """The records as `_core.fit_all` takes them; None where it cannot."""
        return None

    def take(self, x: FloatArray, ended: _core.Ended) -> End:
        """What `_core.fit_all` found from x on."""
        known = self._last is not None and self._last[0] == x.tobytes()
        self.evaluations += ended["evaluations"] - known
        at, hessian = ended["theta"][self.free] / self.scale, ended["hessian"] * np.outer(self.scale, self.scale)
        self._last = (at.tobytes(), hessian, ended["gradient"] * self.scale, ended["cost"])
        return End(ended["theta"], ended["cost"], ended["status"])

    def theta(self, x: FloatArray) -> FloatArray:
        """All parameters of the model at x."""
        theta = self.model.theta
        theta[self.free] = x * self.scale
        return theta

    def normal_equations(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """J'J and J'r by x, and r'r."""
        if self._last is None or self._last[0] != x.tobytes():
            hessian, gradient, cost = self._evaluate(self.theta(x))
            self.evaluations += 1
            self._last = (x.tobytes(), hessian * np.outer(self.scale, self.scale), gradient * self.scale, cost)
            is_lower = cost < self._best[0]
            self._uphill = 0 if is_lower else self._uphill + 1
            if is_lower:
                self._best = (cost, x.copy())
            if self.progress is not None:
                self.progress(self.evaluations, cost)
        return self._last[1:]

    def promise(self, theta: FloatArray) -> float:
        """See `promised_fall`, from these parameters."""
        hessian, gradient, _ = self.normal_equations(theta[self.free] / self.scale)
        return promised_fall(hessian, gradient)

    def descend(
        self,
        x: FloatArray,
        limits: Limits,
        max_evaluations: int,
        step: float = EXACTLY,
        *,
        among_others: bool = False,
        bound: float = np.inf,
    ) -> End:
        """Go downhill from x with SciPy's trust-region method; a step into an unstable loop is rejected.

        To be judged `among_others` J, in units of noise, need be no nearer to its least than distinguishes them; where
        it promises to stay above a bound, it need not be followed.
        """
        self._best, self._gain, self._bound = (np.inf, x), step**1.5, bound
        self._least, self._uphill = NEAR if among_others else self.enough, 0
        self._most_uphill = UPHILL if among_others or self.is_approximate else np.inf
        tiny = 1e-9  # bounds of zero are open: a gain or time constant of zero is no model
        bounds = (np.where(limits[0] == 0.0, tiny, limits[0]), limits[1])
        margin = 1e-12 * np.maximum(1.0, np.abs(x))
        inside = np.clip(x, bounds[0] + margin, bounds[1] - margin)
        try:
            result = least_squares(
                self._residual, inside, self._jacobian, bounds=bounds, method="trf",
                xtol=step, ftol=step**1.25, gtol=step**1.25, max_nfev=max_evaluations,
            )  # fmt: skip
            cost = self.normal_equations(result.x)[2]
        except _Arrived as arrived:
            return arrived.end
        except KeyboardInterrupt:
            cost, x = self._best
            return End(self.theta(x), cost, "stopped")
        status = "max_evaluations" if result.status == 0 else "converged"
        at_bound = (result.active_mask != 0) & (np.abs(result.x) > 10 * tiny) & (self.prior == 0.0)
        return End(self.theta(result.x), cost, "at_bound" if at_bound.any() else status)

    def _residual(self, x: FloatArray) -> FloatArray:
        """The short residual; infinite, which SciPy rejects as a step, where the loop is unstable.

        After a step that led uphill the next one may too: it is tried without derivatives, where these cost more.
        """
        try:
            alone = self._cost_alone(self.theta(x)) if self._uphill else None
            if alone is not None and alone > self._best[0]:
                self._uphill += 1
                short = np.append(np.zeros(len(x)), np.sqrt(self._tempered(alone, x)[1]))
            else:
                short, _ = self._short(x)
        except (UnstableLoopError, ModelError):
            return np.full(len(x) + 1, np.inf)
        if self._uphill > self._most_uphill:
            cost, best = self._best
            raise _Arrived(End(self.theta(best), cost, "converged"))
        return short

    def _jacobian(self, x: FloatArray) -> FloatArray:
        short, jacobian = self._short(x)
        gain, cost = float(short[:-1] @ short[:-1]), float(short @ short)  # what a step would gain, bounds or not
        measured = self.normal_equations(x)[2]
        left, _ = self._tempered(measured, x)
        if gain < max(self._gain * cost, self._least) or measured - UNDERSTATED * gain * left > self._bound:
            raise _Arrived(End(self.theta(x), measured, "converged"))
        return jacobian

    def _tempered(self, cost: float, x: FloatArray) -> tuple[float, float]:
        return tempered_cost(cost, self.prior * self.scale**2, x, self.size)

    def _short(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        weights = self.prior * self.scale**2
        hessian, gradient, cost = tempered(*self.normal_equations(x), weights, x, self.size)
        values, vectors = np.linalg.eigh(hessian)
        roots = np.sqrt(np.maximum(values, values[-1] * 1e-15))
        explained = np.divide(vectors.T @ gradient, roots, out=np.zeros_like(roots), where=roots > 0.0)
        rest = np.sqrt(max(cost - explained @ explained, 0.0))
        return np.append(explained, rest), np.vstack([roots[:, None] * vectors.T, np.zeros(len(x))])


class Problem(LeastSquares):
    """Weighted residuals of the outputs over all samples; the core forms the normal equations."""

    def __init__(
        self,
        model: Model,
        records: tuple[Record, ...],
        free: list[int],
        noise: list[FloatArray],
        factors: Mapping[str, float],
        progress: Callable[[int, float], None] | None,
    ) -> None:
        super().__init__(model, free, progress)
        self.records, self.factors, self.noise = records, factors, noise
        self.weights = [
            padded(model, record, np.array([factors.get(name, 1.0) for name in record.channels]) / rms)
            for record, rms in zip(records, noise, strict=True)
        ]
        self._data: dict[_core.ClosedLoop, list[_core.Data]] = {}  # by operating point
        for record, w in zip(records, self.weights, strict=True):
            core = model.at(record).loop.core
            z = padded(model, record, record.outputs)
            data = _core.Data(core, model.excitation(record), z, w)
            self._data.setdefault(core, []).append(data)

    def _evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        size = len(self.free)
        hessian, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for core, data in self._data.items():
            own, own_gradient, squares = _core.normal_equations(core, theta, self.free, data)
            hessian, gradient, cost = hessian + own, gradient + own_gradient, cost + float(squares.sum())
        return hessian, gradient, cost

    def for_core(self) -> _core.Records:
        """All samples, by operating point."""
        return {"samples": list(self._data.items())}

    def with_noise(self, noise: list[FloatArray]) -> Problem:
        """The same problem with other noise levels."""
        other = Problem(self.model, self.records, self.free, noise, self.factors, self.progress)
        other.evaluations = self.evaluations
        return other

    def beside(self, known: Sequence[int]) -> Problem:
        """The same problem with further parameters, values of the rig file that are known to a tolerance."""
        if not known:
            return self
        model, free = self.model.opened(), [*self.free, *known]
        other = Problem(model, self.records, free, self.noise, self.factors, self.progress)
        other.evaluations = self.evaluations
        return other

    def residual_rms(self, theta: FloatArray) -> list[FloatArray]:
        """Rms of each channel's residual, per record."""
        at, found = self.model.with_theta(theta), []
        for record in self.records:
            p = len(record.channels)
            rms = (record.outputs - at.response(record)[:, :p]).std(axis=0)
            found.append(np.where(rms > 0.0, rms, 1.0))
        return found


def gone(steps: Generator[Descent, End, T]) -> T:
    """What descents lead to that are gone one after the other; an interrupt is left to who waits for their ends."""
    try:
        descent = next(steps)
        while True:
            try:
                end = descent.alone()
            except KeyboardInterrupt as interrupt:
                descent = steps.throw(interrupt)
            else:
                descent = steps.send(end)
    except StopIteration as done:
        found: T = done.value
        return found


def promised_fall(hessian: FloatArray, gradient: FloatArray) -> float:
    """By how much a quadratic form falls to its least."""
    return float(gradient @ np.linalg.lstsq(hessian, gradient, rcond=1e-12)[0])


def is_barred(promised: float, cost: float) -> bool:
    """Whether a step that promises much was not gone: the loop is unstable further on."""
    return promised > 0.1 * cost  # no descent ends at an optimum that promises such a part


def padded(model: Model, record: Record, values: FloatArray) -> FloatArray:
    """Values of the channels of a record, in the last dimension, as of all outputs of its loop; zero of the others."""
    more = len(model.at(record).loop.outputs) - values.shape[-1]
    return np.pad(values, [*[(0, 0)] * (values.ndim - 1), (0, more)])


def noise_levels(records: Sequence[Record]) -> list[FloatArray]:
    """Noise rms of each recorded channel, from the scatter over the periods; without periods, the signal's own rms."""
    levels = []
    for record in records:
        ceilings = noise_ceiling(record)
        deviation = record.outputs.std(axis=0)
        share = np.array([1.0 - ceilings.get(name, np.nan) / 100.0 for name in record.channels])
        rms = np.where(np.isnan(share), 1.0, share) * deviation
        levels.append(np.where(rms > 0.0, rms, 1.0))
    return levels
