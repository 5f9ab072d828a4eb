"""Which combinations of parameters the records determine, and which are near the limit of that.

What a transient of noise shows of a loop counts for nothing: poles of noise that goes round it look like those of free
motion. So where not all is surely known, it is asked what the excitation alone determines. Free motion that does
determine a parameter well is not asked about; near that limit, too, it is reported which side of it records are on.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.covariance import UNSEEN_VARIANCE, inverted, sizes
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.transients import freed, orthonormal

NEAR_LIMIT = Kind(
    "near_limit_of_identifiability",
    "warning",
    "{parameters} in combination: relative standard deviation {relative_std_error:.2g}, near the limit of {limit:g} "
    "above which records do not determine a parameter",
    "excite every axis, at more frequencies, with more amplitude or over more periods",
)
NEAR_FREE_MOTION = Kind(
    "near_limit_of_free_motion",
    "warning",
    "the excitation does not determine {parameters}; free motion does, to a relative standard deviation of "
    "{relative_std_error:.2g}, near the limit of {limit:g} up to which that counts",
    "excite at lower frequencies, with longer periods of the excitation",
)
WHOLLY_UNKNOWN = 1.0
"""A combination of parameters with a relative standard deviation above this is not identifiable."""
NEAR = 2.0
"""Factor to either side of that, within which it is reported: a standard deviation is not known better."""
NAMED = 0.05
"""Part of the largest relative change of a combination, above which a parameter belongs to it."""
DOUBTFUL = 0.05
"""Relative standard deviation above which it counts what the excitation alone determines."""
SEVERAL = 10.0
"""Lines that share the power of an excitation, beyond which it is more than a sine that falls between lines."""
RESOLVED = 0.01
"""Relative difference of frequencies at which two records of a single sine each have not the same."""
ELSEWHERE = 0.01
"""Part of the misfit of one sine that may stand beside its line: a start that a wrong model takes otherwise leaves a
thousandth, harmonics of a curved force nearly all."""


class Identifiability(NamedTuple):
    """Combinations of parameters, as relative changes, that records do not determine, and what is near that."""

    directions: list[dict[str, float]]
    findings: list[Finding]


def identifiability(comparison: Comparison, free: Sequence[int]) -> Identifiability:
    """Combinations of the free parameters that the excitation of the records does not determine.

    Judged by the noise alone, whatever the misfit. Where a record is the free response of the loop, all of it counts.
    """
    model, scale = comparison.model, sizes(comparison.model, free)
    by_all = _covariance(comparison.noise.quadratic(model, free).hessian * np.outer(scale, scale))
    worst = float(np.sqrt(np.diag(by_all).max(initial=0.0)))
    is_driven = not any(record.is_free_response for record in comparison.noise.records)
    if not is_driven or worst <= DOUBTFUL / NEAR:
        return judged(by_all * np.outer(scale, scale), model, free)
    by_excitation = _covariance(_by_excitation(comparison, free))
    decides = by_excitation if worst > DOUBTFUL else by_all
    found = judged(decides * np.outer(scale, scale), model, free)
    if worst < DOUBTFUL * NEAR:
        missed = undetermined(by_excitation * np.outer(scale, scale), model, free)
        names = [own.name for own in model.parameters if any(own.name in direction for direction in missed)]
        if names:
            near = NEAR_FREE_MOTION(NOWHERE, parameters=names, relative_std_error=worst, limit=DOUBTFUL)
            found.findings.append(near)
    return found


def judged(covariance: FloatArray, model: Model, free: Sequence[int]) -> Identifiability:
    """The same by a covariance, see `undetermined`."""
    return Identifiability(undetermined(covariance, model, free), _near_limit(covariance, model, free))


def lost(comparison: Comparison, free: Sequence[int]) -> list[dict[str, float]]:
    """Combinations of the free parameters that the records do not determine, see `identifiability`."""
    return identifiability(comparison, free).directions


def weakest(comparison: Comparison, free: Sequence[int]) -> list[dict[str, float]]:
    """Combinations of the free parameters that the excitation determines least, whether enough or not."""
    scale = sizes(comparison.model, free)
    own = _covariance(_by_excitation(comparison, free))
    worst = 2.0 * WHOLLY_UNKNOWN**2 / np.linalg.eigvalsh(own)[-1]
    return undetermined(worst * own * np.outer(scale, scale), comparison.model, free)


def only_frequency(comparison: Comparison, free: Sequence[int]) -> float | None:
    """The one frequency at which records in time contain all that they contain beside noise [Hz].

    There a loop is two numbers for each channel, whatever is in it, and effects are not distinguished. None where the
    excitation determines something of a parameter beside such numbers, by `WHOLLY_UNKNOWN`, where more than noise
    is left beside them, such as harmonics, or where nothing drives a record.
    """
    parts, records = comparison.noise.in_time, comparison.noise.records
    if len(parts) < len(records) or any(part.record.is_free_response for part in parts):
        return None
    if any(part.lines_driven > SEVERAL for part in parts):
        return None
    rest, left = np.zeros((len(free), len(free))), 0.0
    residuals = comparison.noise.by_record(comparison.residual)
    for part, residual, columns, basis in zip(parts, residuals, *_driven(comparison, free), strict=True):
        known = orthonormal(np.hstack([basis, part.constant_responses]))
        columns, residual = freed(columns, known), freed(residual, known)
        rest, left = rest + columns.T @ columns, left + float(residual @ residual)
    at_noise = max(comparison.bound * comparison.dof, ELSEWHERE * comparison.cost)
    if np.linalg.eigvalsh(rest)[-1] > 1.0 / WHOLLY_UNKNOWN**2 or left > at_noise:
        return None
    frequencies = [part.index[part.loudest] * part.record.sample_rate / part.window.samples for part in parts]
    return float(frequencies[0]) if np.ptp(frequencies) < RESOLVED * frequencies[0] else None


def undetermined(covariance: FloatArray, model: Model, free: Sequence[int]) -> list[dict[str, float]]:
    """Combinations of parameters, as relative changes, that the records do not determine.

    Parameters
    ----------
    covariance : ndarray, shape (free, free)
    model : Model
        At the values that the covariance belongs to.
    free : sequence of int
    """
    return [direction for deviation, direction in _directions(covariance, model, free) if deviation > WHOLLY_UNKNOWN]


def _directions(covariance: FloatArray, model: Model, free: Sequence[int]) -> list[tuple[float, dict[str, float]]]:
    """Independent combinations of parameters: relative standard deviation and relative changes, the surest first."""
    own, scale = [model.parameters[i] for i in free], sizes(model, free)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    found = []
    for deviation, vector in zip(np.sqrt(np.maximum(values, 0.0)), vectors.T, strict=True):
        vector = vector / vector[np.argmax(np.abs(vector))]
        shares = {p.name: float(v) for p, v in zip(own, vector, strict=True) if abs(v) > NAMED}
        found.append((float(deviation), shares))
    return found


def _near_limit(covariance: FloatArray, model: Model, free: Sequence[int]) -> list[Finding]:
    """Of combinations to either side of the limit, by how much."""
    return [
        NEAR_LIMIT(NOWHERE, parameters=list(direction), relative_std_error=deviation, limit=WHOLLY_UNKNOWN)
        for deviation, direction in _directions(covariance, model, free)
        if WHOLLY_UNKNOWN / NEAR < deviation < WHOLLY_UNKNOWN * NEAR
    ]


def _covariance(hessian: FloatArray) -> FloatArray:
    inverse, unseen = inverted(hessian)
    return inverse + UNSEEN_VARIANCE * unseen @ unseen.T


def _by_excitation(comparison: Comparison, free: Sequence[int]) -> FloatArray:
    """J'J of what the excitation alone determines, by the scaled parameters."""
    parts = zip(*_driven(comparison, free), strict=True)
    slopes = np.vstack([freed(columns, basis) for columns, basis in parts])
    return slopes.T @ slopes


def _driven(comparison: Comparison, free: Sequence[int]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Whitened derivatives by the scaled parameters, and what a transient can look like, of each record."""
    model, noise = comparison.model, comparison.noise
    return noise.by_record(noise.slopes(model, free) * sizes(model, free)), noise.transients(model)
