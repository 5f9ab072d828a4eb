"""A model at the minimum of J, the misfit in noise units."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import chdtri

from ambid import _core
from ambid.arrays import FloatArray
from ambid.errors import UnstableLoopError
from ambid.identification.problem import EXACTLY, NEAR, ROUGHLY, End, LeastSquares
from ambid.model import Model
from ambid.noise import Comparison, Noise, Quadratic
from ambid.noise.known import Size, known_residual, known_weights

HIDDEN = 0.5
"""Whitened difference of two responses that moves no parameter by more than so many standard errors."""
SETTLED = 0.01
"""Fall of J by new angles that ends this."""
DRIVEN_OFF = 1e-3
"""Chance of errors of the rig file below which what a model lacks has made them."""
AT_JUMP, BEHIND_JUMP = 0.1, 0.3
"""Of the tolerance of an instant: how near a jump it counts as at it, how far behind that a descent begins again."""
SUBSTEPS, MOST_SUBSTEPS = 2, 32
"""Steps per sample of nonlinear effects, of a score and at the most of a fit: neither needs six digits."""


class WhitenedProblem(LeastSquares):
    """J as a function of the free parameters; `roughly` with derivatives that are near enough, see `Noise`."""

    def __init__(
        self,
        model: Model,
        noise: Noise,
        free: Sequence[int] | None = None,
        progress: Callable[[int, float], None] | None = None,
        *,
        roughly: bool = False,
    ) -> None:
        super().__init__(model, list(range(len(model.names))) if free is None else list(free), progress)
        self.noise, self.roughly = noise, roughly
        self._before: tuple[FloatArray, Quadratic] | None = None

    def in_noise(self, noise: Noise, model: Model, free: Sequence[int]) -> WhitenedProblem:
        """J of a model in other noise."""
        other = WhitenedProblem(model, noise, free, self.progress)
        other.evaluations = self.evaluations
        return other

    def _evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        near = list[FloatArray]()
        if self._before is not None:  # transients change with the parameters
            step, before = theta[self.free] - self._before[0][self.free], self._before[1]
            near = [d + step @ slope for d, slope in zip(before.transients, before.transient_slopes, strict=True)]
        here = self.model.with_theta(theta)
        found = self.noise.quadratic(here, self.free, near, roughly=self.roughly, shortly=self.roughly)
        self._before = (theta, found)
        return found.hessian, found.gradient, found.cost

    @property
    def is_approximate(self) -> bool:
        """See `LeastSquares.is_approximate`; of a nonlinear model those by errors of the rig file are, see `Noise`."""
        return not self.model.is_linear and bool(self.prior.any())

    def _cost_alone(self, theta: FloatArray) -> float | None:
        here = self.model.with_theta(theta)
        return None if here.is_linear else self.noise.quadratic(here, [], shortly=self.roughly).cost

    def promises(self, other: FloatArray, theta: FloatArray) -> bool:
        """Whether J may be lower about another place than at one, by the parabola there."""
        short, _ = self._short(other[self.free] / self.scale)
        here, _ = self._short(theta[self.free] / self.scale)
        return float(short[-1] ** 2) < float(here @ here) - NEAR

    @property
    def prior(self) -> FloatArray:
        """See `LeastSquares.prior`."""
        return known_weights(self.model, self.free)

    @property
    def size(self) -> Size:
        """See `LeastSquares.size`."""
        return self.noise.size if self.prior.any() else Size()

    def for_core(self) -> _core.Records | None:
        """All judged lines, by operating point, where all models of them are linear."""
        data = self.noise.on_lines(self.model)
        return None if data is None else {"lines": [(core, [own for *_, own in some]) for core, some in data.items()]}

    def take(self, x: FloatArray, ended: _core.Ended) -> End:
        """What was found; the quadratic form about it need not be found again."""
        end = super().take(x, ended)
        self.noise.remember(self.model.with_theta(end.theta), self.free, ended)
        return end


def refit(comparison: Comparison, most: int = 40, step: float = EXACTLY, bound: float = np.inf) -> Comparison:
    """Minimise J over all parameters of the model; nonlinear effects in such steps that the noise hides what they miss.

    Of several records, each determines the angle at which the waves of the model begin it: what a channel contains of a
    wave is turned by the loop, differently at every speed.

    Parameters
    ----------
    comparison : Comparison
    most : int
        Evaluations.
    step : float
        Relative step at which the descent ends; `ROUGHLY` distinguishes rivals.
    bound : float
        J that is reached already: a descent that promises no less is not followed.
    """
    fit = _descended(comparison.of(comparison.model.opened()), most, step, bound)
    # so often are the angles of waves asked for anew, at the most, beside the parameters that change them
    for _ in range(3 if step < ROUGHLY and fit.waves_differ else 0):
        better = _descended(fit.with_own_angles(), most, step)
        fell, fit = fit.cost - better.cost, min(better, fit, key=lambda each: each.cost)
        if fell < SETTLED:
            break
    return fit


def _descended(comparison: Comparison, most: int, step: float, bound: float = np.inf) -> Comparison:
    model = resolved(comparison)
    fit = _from(comparison, model, most, step, bound)
    # what an effect has grown to may need finer steps than what it began with
    while fit.cost <= bound and (finer := resolved(fit)).structure.substeps != fit.model.structure.substeps:
        fit = _from(fit, finer, most, step, bound)
    return fit


def resolved(comparison: Comparison) -> Model:
    """The model with twice as many steps per sample as change its response, halved, by less than the noise shows."""
    model = comparison.model
    if model.is_linear:
        return model
    steps, left = 1, comparison if model.structure.substeps else comparison.of(model.with_substeps(SUBSTEPS))
    while 2 * steps < MOST_SUBSTEPS and not _is_hidden(left, *(model.with_substeps(k * steps) for k in (1, 2))):
        steps *= 2
    return model.with_substeps(max(2 * steps, model.structure.substeps or 0))


def _from(comparison: Comparison, model: Model, most: int, step: float, bound: float) -> Comparison:
    """The optimum of a model whose steps are given; roughly, half of them are enough."""
    held, near = model, max(step, ROUGHLY)
    if step >= ROUGHLY and not model.is_linear:
        half = model.with_substeps((model.structure.substeps or SUBSTEPS) // 2)
        held = half if _is_finite(comparison.of(half)) else model
    roughly = step >= ROUGHLY
    if not _is_near(model) and (exact := held.without_errors()).may_stand:
        # many derivatives, and errors that a model without the effect drove off: both are met near the optimum alone
        begun = WhitenedProblem(exact, comparison.noise, model.free, roughly=roughly)
        held = held.with_theta(_gone(begun, most, near))
    problem = WhitenedProblem(held, comparison.noise, roughly=roughly)
    end = _gone(problem, most, step, bound)
    fit = comparison.of(model.with_theta(end))
    behind = other_side(problem, end) if fit.cost <= bound else None
    if behind is not None and problem.promises(behind, fit.model.theta):
        begun = WhitenedProblem(held.with_theta(behind), comparison.noise, roughly=True)
        there = comparison.of(model.with_theta(_gone(begun, most, near)))
        if there.cost < fit.cost and near > step:
            problem.model = held.with_theta(there.model.theta)
            there = comparison.of(model.with_theta(_gone(problem, most, step)))
        fit = min(fit, there, key=lambda own: own.cost)
    return fit


def other_side(problem: WhitenedProblem, theta: FloatArray) -> FloatArray | None:
    """Where to begin again, if a descent may have ended at the instant at which held commands jump; else None.

    A reading of a moment earlier misses what the jump brings, so that J has another slope on either side of it.
    """
    model = problem.model
    late = {own.slot for own in model.loop.lft.late_outputs}
    for k, p in enumerate(model.parameters):
        if p.prior is not None and p.name in late and k in problem.free and abs(theta[k]) < AT_JUMP * p.prior:
            at = problem.free.index(k)
            hessian, _, _ = problem.normal_equations(theta[problem.free] / problem.scale)
            if hessian[at, at] * (p.prior / problem.scale[at]) ** 2 > 1.0 / AT_JUMP:
                other = theta.copy()
                other[k] = -np.copysign(BEHIND_JUMP * p.prior, theta[k])
                return other
    return None


def _is_near(model: Model) -> bool:
    """Whether errors of the rig file, where it has tolerances, were found, and are no larger than chance makes them."""
    errors = known_residual(model)
    return 0.0 < float(errors @ errors) < chdtri(len(errors), DRIVEN_OFF) if len(errors) else True


def _gone(problem: WhitenedProblem, most: int, step: float, bound: float = np.inf) -> FloatArray:
    """All parameters where a descent from those of the problem's model ends."""
    parameters = [problem.model.parameters[i] for i in problem.free]
    lower, upper, at = np.array([(p.lower, p.upper, p.value) for p in parameters]).T / problem.scale
    end = problem.descend(at, (lower, upper), most, step, among_others=step >= ROUGHLY, bound=bound)
    if end.status == "stopped":
        raise KeyboardInterrupt from None
    return end.theta


def _is_finite(comparison: Comparison) -> bool:
    """Whether steps are fine enough for a response that does not grow without bound."""
    try:
        return bool(np.isfinite(comparison.cost))
    except UnstableLoopError:
        return False


def _is_hidden(comparison: Comparison, model: Model, other: Model) -> bool:
    """Whether the responses of two models differ by less than the noise shows, or than what is left of the records."""
    noise = comparison.noise
    try:
        shown = HIDDEN * np.sqrt(noise.size.variance(comparison.cost))
        return float(np.linalg.norm(noise.departure(model) - noise.departure(other))) < shown
    except UnstableLoopError:
        return False


def criterion(comparison: Comparison) -> float:
    """``J + q ln N`` with q parameters and N numbers judged (Schwarz): fewest win among equals."""
    return comparison.cost + float(np.log(comparison.noise.lines)) * len(comparison.model.free)
