"""Values of the rig file that several fits of one machine share: what all records together make of them.

Fits of one machine at several operating points each have an error d of every value that is known to a tolerance, and
the machine has one. A fit p is a Gaussian of its parameters and of d, with mean d_p and covariance C_p, of which the
rig file's own knowledge L (diagonal, one over the variances) is a part. It must count once:

    C^-1 = L + sum (C_p^-1 - L),    C^-1 d = sum C_p^-1 d_p,

and what is correlated with d moves with it, ``theta_p + G (d - d_p)`` with ``G = cov(theta_p, d) C_p^-1``; its
covariance is ``cov(theta_p) - G C_p G' + G C G'``. That is the minimum of the sum of all J as quadratic forms, each
linearised where its fit ended, the parameters of the others eliminated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import ModelError
from ambid.identification.estimate import Estimate, ParameterEstimate
from ambid.identification.tolerances import NOISE, TYPICAL, VALUE_MOVED, findings_of, known_values
from ambid.model.operating_point import require_same_machine


class _Common(NamedTuple):
    """Errors of the rig file by all fits, in units of their tolerances."""

    mean: FloatArray
    covariance: FloatArray


def common_tolerances(estimates: Sequence[Estimate]) -> tuple[str, ...]:
    """Names of the known values that all fits have in common; none where they are not of one machine.

    One machine has one rotor and one amplifier, its magnets and sensors at the same places, each known to the same
    tolerance, see `require_same_machine`.
    """
    first, *others = estimates
    for other in others:
        try:
            require_same_machine(first.model.rig, other.model.rig)
        except ModelError:
            return ()
    shared = (name for name in first.tolerances if all(name in own.tolerances for own in others))
    return tuple(n for n in shared if all(own.tolerances[n].std == first.tolerances[n].std for own in others))


def with_common_tolerances(estimates: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """The same fits with the values of the rig file where all their records together have them.

    Parameters
    ----------
    estimates : sequence of Estimate
        Of one machine, at any operating points, no record in two of them.

    Returns
    -------
    tuple of Estimate
        As they were where nothing is common to them.
    """
    if len(estimates) < 2 or not (names := common_tolerances(estimates)):
        return tuple(estimates)
    std = np.array([estimates[0].tolerances[name].std for name in names])
    precision, pull = np.eye(len(names)), np.zeros(len(names))
    for estimate in estimates:
        at = _places(estimate, names)
        values, vectors = np.linalg.eigh(_covariance(estimate)[np.ix_(at, at)] / np.outer(std, std))
        narrow = values < 1.0  # where misfit has widened a fit beyond the rig file, it adds nothing
        weights = np.where(narrow, 1.0 / values, 1.0)
        precision += (vectors * (weights - 1.0)) @ vectors.T
        pull += (vectors * np.where(narrow, weights, 0.0)) @ (vectors.T @ (estimate.model.theta[at] / std))
    covariance: FloatArray = np.linalg.inv(precision).astype(np.float64)
    common = _Common(covariance @ pull, covariance)
    return tuple(_moved(estimate, names, std, common) for estimate in estimates)


def _places(estimate: Estimate, names: Sequence[str]) -> list[int]:
    """Of parameters in the model."""
    index = {name: i for i, name in enumerate(estimate.model.names)}
    return [index[name] for name in names]


def _covariance(estimate: Estimate) -> FloatArray:
    """Of all parameters of the model, NaN of those that were not free or not determined."""
    found = estimate.model.covariance
    assert found is not None
    return found


def _moved(estimate: Estimate, names: Sequence[str], std: FloatArray, common: _Common) -> Estimate:
    """A fit whose known values are the common ones."""
    before, theta = _covariance(estimate), estimate.model.theta
    at = _places(estimate, names)
    determined = np.isfinite(np.diag(before))
    own = [i for i, is_known in enumerate(determined.tolist()) if is_known and i not in at]
    by_own = before[np.ix_(at, at)] / np.outer(std, std)
    slope = np.linalg.solve(by_own, before[np.ix_(at, own)] / std[:, None]).T
    theta[own] += slope @ (common.mean - theta[at] / std)
    theta[at] = std * common.mean
    lower, upper = np.array([(p.lower, p.upper) for p in estimate.model.parameters]).T
    theta = np.clip(theta, lower, upper)
    together = slope @ common.covariance
    whole = before.copy()
    whole[np.ix_(own, own)] += together @ slope.T - slope @ by_own @ slope.T
    whole[np.ix_(own, at)] = together * std
    whole[np.ix_(at, own)] = whole[np.ix_(own, at)].T
    whole[np.ix_(at, at)] = common.covariance * np.outer(std, std)

    model = estimate.model.with_theta(theta)
    index = {name: i for i, name in enumerate(model.names)}
    parameters, variances = dict(estimate.parameters), dict(estimate.variances)
    for name, p in parameters.items():
        if p.value is None:
            continue
        i = index[name]
        row = together[own.index(i)] ** 2
        total = float(whole[i, i])
        variances[name] = _budget(estimate.variances[name], dict(zip(names, row.tolist(), strict=True)), total)
        by_noise = float(np.sqrt(variances[name][NOISE]))
        parameters[name] = ParameterEstimate.of(model.parameters[i], float(np.sqrt(total)), by_noise)
    fitted = [index[name] for name in parameters]
    tolerances = known_values(model, whole, [index[name] for name in estimate.tolerances])
    findings = [own for own in estimate.findings if own.kind not in (TYPICAL, VALUE_MOVED)]
    return replace(
        estimate,
        model=model.with_covariance(whole),
        parameters=parameters,
        covariance=whole[np.ix_(fitted, fitted)],
        comparison=estimate.comparison.of(model),
        tolerances=tolerances,
        variances=variances,
        findings=(*findings, *findings_of(model.rig, tolerances)),
    )


def _budget(before: Mapping[str, float], common: Mapping[str, float], total: float) -> dict[str, float]:
    """Variance by what it comes from; noise is that of all records."""
    by_known = {name: own for name, own in before.items() if name != NOISE} | dict(common)
    return {NOISE: max(total - sum(by_known.values()), 0.0)} | by_known
