"""A start from a record whose samples fade away, for fits that the edge of stability keeps from their optimum."""

from collections.abc import Sequence

import numpy as np

from ambid.arrays import FloatArray
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import ROUGHLY, Limits
from ambid.loop.loop import open_plant
from ambid.model import Model
from ambid.model.parameter import nominal
from ambid.noise import Noise
from ambid.record import Record

FIRST = 0.1
"""Of the rate at which the rotor falls with the controller off: by about as much are the modes on the magnets moved
where K_i and K_s are some 10 % off, as nominal ones are."""
UNFELT = 0.01
"""Part by which a record decays in the end: so little distinguishes a loop that decays slowly from one that grows."""
CORRECTIONS, BEYOND = 8, 0.1
"""Steps to a loop that decays fast enough, and the part of each by which it goes too far: the rate is not linear."""
LIKELY = 0.5
"""Of K_i, K_s and time constants: standard deviation of what their start values are likely to be off by."""
STEP = 1e-6
"""Of a parameter, from which the slope of the rate of decay is taken."""


class NearStart(WhitenedProblem):
    """J, and how far the parameters of every rig are from those of the model, in units of what is likely.

    What few lines, or a damped record, do not determine stays there: else it goes to where the loop cannot come back
    from.
    """

    def for_core(self) -> None:
        """Not at all: it knows J alone."""
        return

    def _evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        hessian, gradient, cost = super()._evaluate(theta)
        usual = {p.name for p in nominal(self.model.rig)}
        own = [self.model.parameters[i] for i in self.free]
        weight = np.array([1.0 / (LIKELY * max(abs(p.value), p.scale)) if p.name in usual else 0.0 for p in own])
        off = weight * (theta - self.model.theta)[self.free]
        return hessian + np.diag(weight**2), gradient + weight * off, cost + float(off @ off)


def damped_start(
    stable: Model,
    records: Sequence[Record],
    free: list[int],
    limits: Limits,
    kind: type[WhitenedProblem] = WhitenedProblem,
) -> tuple[FloatArray, int]:
    """Values near the optimum, of fits to records that fade away ever slower.

    Parameters
    ----------
    stable : Model
        Where the first fit starts; nonlinear effects are left out of it.
    records : sequence of Record
    free : list of int
        Its free parameters.
    limits : tuple of ndarray
        Lower and upper bounds of x.
    kind : type
        `NearStart` where the edge of stability is what keeps a fit from its optimum.

    Returns
    -------
    x : ndarray, shape (free,)
        Of a stable loop, in units of the parameters' scales.
    evaluations : int
    """
    linear = stable.without_nonlinear()
    shared = [k for k, i in enumerate(free) if stable.names[i] in linear.names]
    own = [linear.names.index(stable.names[free[k]]) for k in shared]
    bounds = limits[0][shared], limits[1][shared]
    begin, theta, evaluations = linear.theta, linear.theta, 0
    dampings = _dampings(linear, records)
    for damping, then in zip(dampings, (*dampings[1:], 0.0), strict=True):
        problem = kind(linear, Noise.rough(linear, records, damping), own)
        end = problem.descend(theta[own] / problem.scale, bounds, 40, ROUGHLY)
        if end.status == "stopped":
            raise KeyboardInterrupt from None
        evaluations += problem.evaluations
        theta = _back(problem, begin, end.theta, -then, bounds)
    found = dict(zip(linear.names, theta, strict=True))
    scale = np.array([stable.parameters[i].scale for i in free])
    return np.array([found.get(stable.names[i], stable.theta[i]) for i in free]) / scale, evaluations


def _dampings(model: Model, records: Sequence[Record]) -> list[float]:
    """From what widens the modes on the magnets well to what a record does not feel [1/s]."""
    last = UNFELT / max(record.samples / record.sample_rate for record in records)
    found = [max(FIRST * _growth(model), last)]
    while found[-1] > last:
        found.append(0.25 * found[-1])  # damping from one fit to the next
    return found


def _growth(model: Model) -> float:
    """Rate at which the loop leaves with its controller off [1/s]."""
    at = {slot: parameter.value for parameter in model.parameters for slot in parameter.slots}
    return float(np.linalg.eigvals(open_plant(model.rig, model.acting).closed(at)[0]).real.max())


def _back(problem: WhitenedProblem, begin: FloatArray, theta: FloatArray, least: float, bounds: Limits) -> FloatArray:
    """Values near `theta` whose loop decays by more than `least` [1/s]: those that cost the fit least, by its Hessian;
    failing them, as much of the way from `begin` as does."""
    model, own, scale = problem.model, problem.free, problem.scale
    if model.with_theta(theta).decay_rate > least:
        return theta
    hessian = problem.normal_equations(theta[own] / scale)[0]
    nearest = theta.copy()
    for _ in range(CORRECTIONS):
        decays = model.with_theta(nearest).decay_rate
        if decays > least:
            return nearest
        slope = _slope(model.with_theta(nearest), own, scale)
        way = np.linalg.lstsq(hessian, slope)[0]
        x = nearest[own] / scale + (1.0 + BEYOND) * (least - decays) / (slope @ way) * way
        nearest[own] = scale * np.clip(x, np.maximum(bounds[0], 1e-9), bounds[1])  # bounds of zero are open
    low, high = 0.0, 1.0
    for _ in range(12):  # of the way back to a stable loop, where steps do not lead there
        middle = 0.5 * (low + high)
        decays = model.with_theta(begin + middle * (theta - begin)).decay_rate > least
        low, high = (middle, high) if decays else (low, middle)
    return np.asarray(begin + low * (theta - begin))


def _slope(model: Model, own: list[int], scale: FloatArray) -> FloatArray:
    """Of the rate of decay by each parameter in units of its scale: it shows a way and is in no result, so that
    differences do, back from what is at its upper bound."""
    begin, steps = model.decay_rate, np.zeros((len(own), len(model.theta)))
    upper = np.array([model.parameters[i].upper for i in own])
    ways = np.where(model.theta[own] + STEP * scale <= upper, STEP, -STEP)
    steps[range(len(own)), own] = ways * scale
    return np.array([model.with_theta(model.theta + step).decay_rate - begin for step in steps]) / ways
