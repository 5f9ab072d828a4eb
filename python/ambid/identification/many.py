"""Many identifications at once: their descents run side by side in the core, and each may fail by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambid import _core
from ambid.arrays import ByValue, FloatArray
from ambid.errors import AmbidError, ModelError, Stopped
from ambid.identification.closed_loop import LIKELIHOOD, Found, Steps, steps
from ambid.identification.known_noise import (
    FoundInKnownNoise,
    StepsInKnownNoise,
    noise_of_channels,
    steps_in_known_noise,
)
from ambid.identification.preparation import several
from ambid.identification.problem import Descent, End
from ambid.model import Given, as_model
from ambid.noise import Adequacy
from ambid.record import Source
from ambid.results import Tabular
from ambid.threads import with_one_blas_thread

FAILED = "failed"
"""Status of a run that ended with an error, beside those of `estimate.STATUS`."""
TOGETHER = 32
"""Identifications under way at once: enough for the cores, few enough for the memory."""


@dataclass(frozen=True, repr=False, eq=False)
class Estimates(ByValue, Tabular):
    """Result of `identify_many`; runs in the order of their records.

    Attributes
    ----------
    names : tuple of str
        The free parameters.
    units : tuple of str
    values, std_errors : ndarray, shape (runs, free)
        NaN where the records do not determine it, or the run failed.
    covariances : ndarray, shape (runs, free, free)
    misfit, misfit_bound : ndarray, shape (runs,)
        J/dof, 1 when the model is right, and up to which it may be; NaN where the noise is not known.
    adequate : ndarray of bool, shape (runs,)
    status : tuple of str
        `failed`, or one of those of `Estimate.status`.
    evaluations : ndarray of int, shape (runs,)
    reasons : tuple of str
        Why a run failed, or what its records do not determine; else empty.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    std_errors: FloatArray
    covariances: FloatArray
    misfit: FloatArray
    misfit_bound: FloatArray
    adequate: np.ndarray[tuple[int], np.dtype[np.bool_]]
    status: tuple[str, ...]
    evaluations: np.ndarray[tuple[int], np.dtype[np.int64]]
    reasons: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.status)

    def table(self) -> dict[str, list[Any]]:
        """Runs, a row each."""
        columns: dict[str, list[Any]] = {
            "status": list(self.status),
            "misfit": self.misfit.tolist(),
            "misfit_bound": self.misfit_bound.tolist(),
            "adequate": self.adequate.tolist(),
            "evaluations": self.evaluations.tolist(),
        }
        for k, name in enumerate(self.names):
            columns |= {name: self.values[:, k].tolist(), f"{name} std_error": self.std_errors[:, k].tolist()}
        return columns | {"reason": list(self.reasons)}

    def summary(self) -> list[str]:
        """How many runs ended how, and the first reason of a failure."""
        counts = ", ".join(f"{self.status.count(word)} {word}" for word in sorted(set(self.status)))
        first = next((why for own, why in zip(self.status, self.reasons, strict=True) if own == FAILED), "")
        return [f"{len(self)} runs: {counts}", *([f"the first failure: {first}"] if first else [])]

    def __str__(self) -> str:
        lines = [f"{'parameter':14s} {'mean':>13s} {'scatter':>11s} {'std error':>11s}", "-" * 52]
        known = np.isfinite(self.values)
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            own = self.values[known[:, k], k]
            if len(own) < 2:
                lines.append(f"{name:14s} known in {len(own)} of the runs")
                continue
            stated = float(np.mean(self.std_errors[known[:, k], k]))
            lines.append(f"{name:14s} {own.mean():13.6g} {own.std(ddof=1):11.3g} {stated:11.3g} {unit}")
        return "\n".join([*lines, *self.summary()])


@with_one_blas_thread
def identify_many(
    model: Given | Sequence[Given],
    records: Iterable[Source | Sequence[Source]],
    *,
    free: str | Iterable[str] | None = None,
    fixed: str | Iterable[str] | Mapping[str, float] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    weights: str | Mapping[str, float] = LIKELIHOOD,
    noise: Mapping[str, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    max_evaluations: int = 100,
    progress: Callable[[int], None] | None = None,
) -> Estimates:
    """Identify many times at once: every run as `identify` does, with the same numbers.

    The descents of linear models run in the core over all cores, side by side, and the numbers do not depend
    on how many there are (``RAYON_NUM_THREADS`` sets it). A run that fails is a row with its reason. With the weights
    of eq. 9, runs that repeat one experiment, with the same excitation and start, go down from the optimum of the first
    of them: they end within a thousandth of a standard error of what `identify` finds; the descents cost half.

    Most of an identification is finding the noise of its record. Where that is known, white and on what is recorded, as
    in many a virtual experiment, `noise` says so, and a run is its descent alone, with intervals and misfit.

    Parameters
    ----------
    model : Model or Rig, path of the file of either, or sequence of them
        Start values of all runs, or of each.
    records : iterable
        What each run is identified from: a measurement, or several that are fitted together. Taken one after the other,
        so that a generator keeps only a few in memory.
    free, fixed, bounds, weights, starts, seed, max_evaluations
        As for `identify`.
    noise : mapping of str to float, optional
        Rms of white noise of the signals ``y`` [m] and ``i_c`` [A], or of single channels such as ``y.A_zeta``; it goes
        in place of `weights`. Channels of which nothing is said are left out. Records in time are simulated from rest.
    progress : callable, optional
        Called with the number of runs that are done.

    Returns
    -------
    Estimates

    Raises
    ------
    ModelError
        If a name in `free`, `fixed` or `noise` selects nothing, both `noise` and `weights` are given, or there are
        fewer models than runs.
    Stopped
        At Ctrl-C, with the runs before the first one that is not done, if any; it is a KeyboardInterrupt.
    """
    each = None if isinstance(model, Given) else [as_model(own) for own in model]
    models = [as_model(model)] if isinstance(model, Given) else each or []
    free, fixed = None if free is None else several(free), fixed if isinstance(fixed, Mapping) else several(fixed)
    for own in models:
        own.index(() if free is None else free)
        own.index(tuple(fixed))
        if noise is not None:
            noise_of_channels(own.rig.outputs, noise)
    if noise is not None and weights != LIKELIHOOD:
        raise ModelError("noise is given, which the weights follow from; leave weights out")

    def waiting() -> Iterator[Steps | StepsInKnownNoise]:
        for run, measured in enumerate(records):
            if each is not None and run >= len(each):
                raise ModelError(f"{len(each)} models for more runs than that; give one for each run, or one for all")
            start = models[0] if each is None else each[run]
            options: Any = {
                "free": free,
                "fixed": fixed,
                "bounds": bounds,
                "starts": starts,
                "seed": seed,
                "max_evaluations": max_evaluations,
            }
            if noise is None:
                yield steps(start, measured, weights=weights, **options)
            else:
                yield steps_in_known_noise(start, measured, noise, **options)

    rows: dict[int, _Row] = {}
    try:
        for run, row in _ended(waiting()):
            rows[run] = row
            if progress is not None:
                progress(len(rows))
    except KeyboardInterrupt:
        done = next(run for run in range(len(rows) + 1) if run not in rows)
        if not done:
            raise
        raise Stopped(_estimates([rows[run] for run in range(done)])) from None
    return _estimates([rows[run] for run in range(len(rows))])


@dataclass(frozen=True)
class _Row:
    """One run."""

    status: str
    reason: str = ""
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    values: FloatArray | None = None
    covariance: FloatArray | None = None
    misfit: float = np.nan
    adequacy: Adequacy = Adequacy()
    evaluations: int = 0

    @classmethod
    def of(cls, found: Found | FoundInKnownNoise) -> _Row:
        model, free = found.problem.model, found.problem.free
        own = [k for k, i in enumerate(free) if model.parameters[i].prior is None]
        parameters = [model.parameters[free[k]] for k in own]
        names = tuple(p.name for p in parameters)
        lost = [k for k, name in enumerate(names) if name in found.unknown]
        values, covariance = found.end.theta[[free[k] for k in own]], found.covariance[np.ix_(own, own)]
        values[lost] = covariance[lost, :] = covariance[:, lost] = np.nan
        return cls(
            status=found.status,
            reason=f"not determined: {', '.join(names[k] for k in lost)}" if lost else "",
            names=names,
            units=tuple(p.unit for p in parameters),
            values=values,
            covariance=covariance,
            misfit=found.misfit,
            adequacy=found.adequacy,
            evaluations=found.problem.evaluations,
        )


def _ended(waiting: Iterator[Steps | StepsInKnownNoise]) -> Iterator[tuple[int, _Row]]:
    """Runs as they end: whatever descents are wanted go together, and an identification that ends makes room."""
    active: dict[int, tuple[Steps | StepsInKnownNoise, Descent]] = {}
    numbered, more = enumerate(waiting), True
    while more or active:
        while more and len(active) < TOGETHER:
            if (own := next(numbered, None)) is None:
                more = False
                break
            run, begun = own
            if isinstance(got := _next(begun, None), _Row):
                yield run, got
            else:
                active[run] = begun, got
        ends = _gone([descent for _, descent in active.values()])
        for (run, (own_steps, _)), end in zip(list(active.items()), ends, strict=True):
            if isinstance(got := _next(own_steps, end), _Row):
                del active[run]
                yield run, got
            else:
                active[run] = own_steps, got


def _next(own: Steps | StepsInKnownNoise, end: End | AmbidError | None) -> Descent | _Row:
    """The next descent that an identification wants, or what it ended with."""
    try:
        if isinstance(end, AmbidError):
            return own.throw(end)
        return next(own) if end is None else own.send(end)
    except StopIteration as done:
        return _Row.of(done.value)
    except AmbidError as error:
        return _Row(FAILED, str(error))


def _gone(descents: Sequence[Descent]) -> list[End | AmbidError]:
    """The ends of descents: those that the core can go are gone side by side."""
    fits = {k: fit for k, own in enumerate(descents) if (fit := fit_for_core(own)) is not None}
    found: dict[int, End | AmbidError] = {}
    for k, ended in zip(fits, _core.fit_all(list(fits.values())), strict=True):
        own = descents[k]
        found[k] = ended if isinstance(ended, AmbidError) else own.problem.take(own.x, ended)
    for k, own in enumerate(descents):
        if k not in fits:
            found[k] = end = own.alone()
            if end.status == "stopped":
                raise KeyboardInterrupt
    return [found[k] for k in range(len(descents))]


def fit_for_core(descent: Descent) -> _core.Fit | None:
    """A descent as `_core.fit_all` takes it; None where the core cannot go it."""
    problem, (lower, upper) = descent.problem, descent.limits
    if (records := problem.for_core()) is None:
        return None
    return {
        **records,
        "theta": problem.model.theta,
        "free": list(problem.free),
        "scale": problem.scale,
        "lower": lower,
        "upper": upper,
        "x": np.ascontiguousarray(descent.x),
        "prior": problem.prior,
        "enough": problem.enough,
        "numbers": problem.size.numbers,
        "witnesses": problem.size.witnesses,
        "most": descent.most,
        "step": descent.step,
    }


def _estimates(rows: Sequence[_Row]) -> Estimates:
    units = {name: unit for row in rows for name, unit in zip(row.names, row.units, strict=True)}
    names = tuple(units)
    values = np.full((len(rows), len(names)), np.nan)
    covariances = np.full((len(rows), len(names), len(names)), np.nan)
    for run, row in enumerate(rows):
        if row.values is not None and row.covariance is not None:
            at = [names.index(name) for name in row.names]
            values[run, at] = row.values
            covariances[np.ix_([run], at, at)] = row.covariance
    return Estimates(
        names=names,
        units=tuple(units.values()),
        values=values,
        std_errors=np.sqrt(np.einsum("rpp->rp", covariances)),
        covariances=covariances,
        misfit=np.array([row.misfit for row in rows]),
        misfit_bound=np.array([row.adequacy.bound for row in rows]),
        adequate=np.array([row.adequacy.is_adequate for row in rows], dtype=bool),
        status=tuple(row.status for row in rows),
        evaluations=np.array([row.evaluations for row in rows], dtype=np.int64),
        reasons=tuple(row.reason for row in rows),
    )
