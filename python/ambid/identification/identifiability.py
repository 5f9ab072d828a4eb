"""Which combinations of parameters the records determine: by the excitation, and by free motion that is no noise.

A record that begins in motion holds a free response beside the answer to its excitation, and its poles depend on the
parameters. Where noise goes round the loop there is always some of it. Its derivatives in units of the noise, B for the
transient that was found, are compared with those of transients that the noise alone would have brought, B_k for each of
independent ones of unit variance: what the free motion determines is

    B'B - LOUD sum over k of B_k' B_k,

as far as that is positive. It grows from nothing, so that no parameter is lost or won by a rounding.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambid.arrays import FloatArray
from ambid.identification.covariance import UNSEEN_VARIANCE, inverted, sizes
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.lines import RecordLines
from ambid.noise.transients import freed, independent, orthonormal
from ambid.record import Record

__all__ = ["lost", "only_frequency", "undetermined", "weakest"]

WHOLLY_UNKNOWN = 1.0
"""A combination of parameters with a relative standard deviation above this is not identifiable."""
DOUBTFUL = 0.05
"""Relative standard deviation above which it is asked what the excitation alone determines."""
LOUD = 25.0
"""Power of free motion over what noise alone brings, five standard deviations, from which on it determines anything."""
SEVERAL = 10.0
"""Lines that share the power of an excitation, beyond which it is more than a sine that falls between lines."""
RESOLVED = 0.01
"""Relative difference of frequencies at which two records of a single sine each have not the same."""
ELSEWHERE = 0.01
"""Part of the misfit of one sine that may stand beside its line: a start that a wrong model takes otherwise leaves a
thousandth, harmonics of a curved force nearly all."""


def lost(comparison: Comparison, free: Sequence[int]) -> list[dict[str, float]]:
    """Combinations of the free parameters that the records do not determine, see `undetermined`.

    Judged by the noise alone, whatever the misfit. Free motion counts as far as it exceeds what noise that goes round
    the loop brings; in a record that is the free response of the loop, all of it.
    """
    model, scale = comparison.model, sizes(comparison.model, free)
    own = _covariance(comparison.noise.quadratic(model, free).hessian * np.outer(scale, scale))
    is_driven = not any(isinstance(record, Record) and record.is_free_response for record in comparison.noise.records)
    if is_driven and np.sqrt(np.diag(own).max(initial=0.0)) > DOUBTFUL:
        by_excitation = _by_excitation(comparison, free)
        own = _covariance(by_excitation)
        if np.linalg.eigvalsh(own)[-1] > WHOLLY_UNKNOWN**2:
            own = _covariance(by_excitation + _by_free_motion(comparison, free))
    return undetermined(own * np.outer(scale, scale), model, free)


def weakest(comparison: Comparison, free: Sequence[int]) -> list[dict[str, float]]:
    """Combinations of the free parameters that the excitation determines least, whether enough or not."""
    scale = sizes(comparison.model, free)
    own = _covariance(_by_excitation(comparison, free))
    worst = 2.0 * WHOLLY_UNKNOWN**2 / np.linalg.eigvalsh(own)[-1]
    return undetermined(worst * own * np.outer(scale, scale), comparison.model, free)


def only_frequency(comparison: Comparison, free: Sequence[int]) -> float | None:
    """The one frequency at which records in time tell all that they tell beside noise [Hz].

    There a loop is two numbers for each channel, whatever is in it, and no effect is told from another. None where the
    excitation tells more than nothing of a parameter beside such numbers, as `WHOLLY_UNKNOWN` has it, where more than
    noise is left beside them, such as harmonics, or where nothing drives a record.
    """
    parts, records = comparison.noise.in_time, comparison.noise.records
    if len(parts) < len(records) or any(part.record.is_free_response for part in parts):
        return None
    if any(part.lines_driven > SEVERAL for part in parts):
        return None
    rest, left = np.zeros((len(free), len(free))), 0.0
    residuals = comparison.noise.by_record(comparison.residual)
    for part, residual, columns, basis in zip(parts, residuals, *_driven(comparison, free), strict=True):
        told = orthonormal(np.hstack([basis, part.constant_responses]))
        columns, residual = freed(columns, told), freed(residual, told)
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
    own = [model.parameters[i] for i in free]
    scale = sizes(model, free)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    found = []
    for vector in vectors[:, np.sqrt(np.maximum(values, 0.0)) > WHOLLY_UNKNOWN].T:
        vector = vector / vector[np.argmax(np.abs(vector))]
        found.append({p.name: float(v) for p, v in zip(own, vector, strict=True) if abs(v) > 0.05})
    return found


def _covariance(hessian: FloatArray) -> FloatArray:
    inverse, unseen = inverted(hessian)
    return inverse + UNSEEN_VARIANCE * unseen @ unseen.T


def _by_excitation(comparison: Comparison, free: Sequence[int]) -> FloatArray:
    """J'J of what the excitation alone tells, by the scaled parameters."""
    parts = zip(*_driven(comparison, free), strict=True)
    slopes = np.vstack([freed(columns, basis) for columns, basis in parts])
    return slopes.T @ slopes


def _by_free_motion(comparison: Comparison, free: Sequence[int]) -> FloatArray:
    """What free motion adds to J'J beyond what noise alone might, by the scaled parameters."""
    model, scale = comparison.model, sizes(comparison.model, free)
    total = np.zeros((len(free), len(free)))
    for part in comparison.noise.parts:
        if isinstance(part, RecordLines) and part.at(model).is_linear:
            own = _of_transients(part, part.at(model), list(free))
            total += own * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(total)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _of_transients(part: RecordLines, here: Model, free: list[int]) -> FloatArray:
    """What the derivatives of the transient of one record add to J'J, less `LOUD` times what those of noise would."""
    core, theta, data = here.loop.core, here.theta, part.data(here)
    shapes = data.rows(core, theta, [], None, True)[:, :-1]
    basis = orthonormal(shapes)

    def slopes(transient: FloatArray | None) -> FloatArray:
        return freed(data.rows(core, theta, free, transient, False)[:, :-1], basis)

    settled, found = slopes(None), slopes(part.transient(here)[0])
    total = found.T @ found - settled.T @ settled
    for unit in independent(shapes).T:
        of_noise = slopes(np.ascontiguousarray(unit)) - settled
        total -= LOUD * of_noise.T @ of_noise
    return total


def _driven(comparison: Comparison, free: Sequence[int]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Whitened derivatives by the scaled parameters, and what a transient can look like, of each record."""
    model, noise = comparison.model, comparison.noise
    return noise.by_record(noise.slopes(model, free) * sizes(model, free)), noise.transients(model)
