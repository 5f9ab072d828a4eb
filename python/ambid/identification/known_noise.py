"""Identification in noise whose size is known: one descent over samples, and nothing else is asked of a record.

White noise of known rms on what is recorded makes eq. 9 the likelihood: J = sum of ((z - z_model) / rms)^2 over samples
and channels, means removed, and the inverse of J'J is the covariance of the parameters. Noise that goes round the loop,
as a sensor's does, is not white in y: then the intervals of `identify` hold, and these do not.
"""

from collections.abc import Generator, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.covariance import of_hessian
from ambid.identification.identifiability import undetermined
from ambid.identification.preparation import prepare
from ambid.identification.problem import Descent, End, Problem
from ambid.identification.starts import stable_model
from ambid.model import Given
from ambid.noise.adequacy import Adequacy, misfit_criterion
from ambid.record import Source


class FoundInKnownNoise(NamedTuple):
    """What it ends with; its members are those of `Found`."""

    problem: Problem
    end: End
    covariance: FloatArray
    directions: list[dict[str, float]]
    dof: int

    @property
    def misfit(self) -> float:
        """J/dof."""
        return self.end.cost / self.dof

    @property
    def adequacy(self) -> Adequacy:
        """Of the misfit alone; the noise is not estimated."""
        return Adequacy.of([misfit_criterion(self.misfit, self.dof, spread=1.0)])

    @property
    def status(self) -> str:
        """One of `estimate.STATUS`."""
        return "not_identifiable" if self.directions else self.end.status

    @property
    def unknown(self) -> set[str]:
        """Parameters that the records do not determine."""
        return {name for direction in self.directions for name in direction}


StepsInKnownNoise = Generator[Descent, End, FoundInKnownNoise]


def noise_of_channels(outputs: tuple[str, ...], noise: Mapping[str, float]) -> dict[str, float]:
    """Rms of each of these outputs; 0 where nothing is said of it.

    Raises
    ------
    ModelError
        If a name is no channel, or a number is not positive.
    """
    rms = dict.fromkeys(outputs, 0.0)
    for name, size in noise.items():
        own = [output for output in outputs if output == name or output.startswith(f"{name}.")]
        if not own:
            raise ModelError(f"noise: {name} is no channel; expected y, i_c, or one of {', '.join(outputs)}")
        if not 0.0 < size < np.inf:
            raise ModelError(f"noise: {name} = {size}; expected its rms, above 0, in its SI unit")
        rms |= dict.fromkeys(own, size)
    return rms


def steps_in_known_noise(
    model: Given,
    records: Source | Sequence[Source],
    noise: Mapping[str, float],
    *,
    free: str | Iterable[str] | None,
    fixed: str | Iterable[str] | Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]] | None,
    starts: int,
    seed: int,
    max_evaluations: int,
) -> StepsInKnownNoise:
    """The identification, descent by descent.

    Parameters
    ----------
    noise : mapping of str to float
        Rms by signal, ``y`` [m] and ``i_c`` [A], or by channel; channels of which nothing is said are left out.
    model, records, free, fixed, bounds, starts, seed, max_evaluations
        As for `identify`.

    Raises
    ------
    ModelError
        If a name is no channel, a number is not positive, no recorded channel has noise, or a record is not in time.
    """
    prepared = prepare(model, records, free, fixed, bounds, starts, seed, max_evaluations)
    model, measured, in_time, indices, limits, origins, _ = prepared
    rms = noise_of_channels(model.rig.outputs, noise)
    if len(in_time) < len(measured):
        raise ModelError("noise: a frequency response has variances of its own; leave noise out, or such records")
    levels = [np.array([rms[name] or 1.0 for name in record.channels]) for record in in_time]
    problem = Problem(model, in_time, indices, levels, {name: float(own > 0.0) for name, own in rms.items()}, None)
    used = [int(np.count_nonzero(weight)) for weight in problem.weights]
    if not all(used):
        raise ModelError(f"noise: only of {', '.join(noise)}, which is not recorded; give that of y")
    ends: list[End] = []
    for origin in origins:
        try:
            x = np.clip(origin / problem.scale, *limits)
            ends.append((yield Descent(problem, x, limits, max_evaluations)))
        except UnstableLoopError:
            continue
    if not ends:
        stable, _ = stable_model(model, indices, origins, limits)
        ends.append((yield Descent(problem, stable.theta[indices] / problem.scale, limits, max_evaluations)))
    best = min(ends, key=lambda end: end.cost)
    found = of_hessian(problem, best.theta)
    directions = undetermined(found, model.with_theta(best.theta), indices)
    dof = sum((record.samples - 1) * count for record, count in zip(in_time, used, strict=True)) - len(indices)
    return FoundInKnownNoise(problem, best, found, directions, dof)
