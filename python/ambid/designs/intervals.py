"""What a record of a planned experiment would show: standard errors of the parameters, before anything is played."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import InputError
from ambid.identification import ParameterEstimate
from ambid.identification.covariance import budget, covariance
from ambid.identification.tolerances import NOISE, Budget, budget_by_name
from ambid.model import Given, Model, as_model
from ambid.noise import Comparison
from ambid.noise.foreseen import Instruments, foreseen
from ambid.record import Record
from ambid.results import Named, Tabular, named, plain

FEWEST = 4
"""Periods that an experiment has at the least: what differs between them is the noise, and tones and drift need 4."""


@dataclass(frozen=True, repr=False)
class Prospect(Tabular):
    """What a record of an experiment would show; result of `prospect`.

    Attributes
    ----------
    comparison : Comparison
        Of the model with the record as it would come without noise, in the noise that it would have.
    seconds : float
        Length of the record.
    """

    comparison: Comparison
    seconds: float

    @property
    def model(self) -> Model:
        """What the machine is taken to be."""
        return self.comparison.model

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of all parameters, shape (parameters, parameters)."""
        every = covariance(self.comparison, range(len(self.model.names)))
        return every[np.ix_(self.model.free, self.model.free)]

    @cached_property
    def budget(self) -> Budget:
        """Variance of every parameter by what it comes from: ``noise``, and each tolerance of the rig file."""
        rows = budget(self.comparison, range(len(self.model.names)))
        return named(budget_by_name(self.model.names, {p.name for p in self.model.tolerances}, rows))

    @property
    def parameters(self) -> dict[str, ParameterEstimate]:
        """The parameters with the intervals that a fit would give."""
        own = [self.model.parameters[i] for i in self.model.free]
        errors = np.sqrt(np.diag(self.covariance))
        return Named(
            (p.name, ParameterEstimate.of(p, float(error), np.sqrt(self.budget[p.name][NOISE])))
            for p, error in zip(own, errors, strict=True)
        )

    def _scale(self, name: str) -> float:
        return next(p.scale for p in self.model.parameters if p.name == name)

    def table(self) -> dict[str, list[Any]]:
        """A parameter a row."""
        own = self.parameters
        return {
            "parameter": list(own),
            "value": [p.value for p in own.values()],
            "std_error": [p.std_error for p in own.values()],
            "unit": [p.unit for p in own.values()],
        }

    def summary(self) -> list[str]:
        """How long the record is."""
        return [f"foreseen of a record of {self.seconds:.3g} s, if the model lacks nothing"]

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        return plain({"seconds": self.seconds, "parameters": {n: p.as_dict() for n, p in self.parameters.items()}})

    def __str__(self) -> str:
        lines = [self.summary()[0], f"{'parameter':24s} {'value':>12s} {'std error':>12s}"]
        for name, p in self.parameters.items():
            value, error = p.value or 0.0, p.std_error or 0.0
            share = f" ({100.0 * error / abs(value):.2g} %)" if error < abs(value) else ""
            error_text = f"{error:12.3g} {p.unit}{share}" if error < 100.0 * self._scale(name) else "  not determined"
            lines.append(f"{name:24s} {value:12.5g} {error_text}")
        return "\n".join(lines)


def prospect(model: Given, i_e: FloatArray, *, period: int, instruments: Instruments) -> Prospect:
    """Predict what a record of an experiment would show.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        What the machine is taken to be.
    i_e : ndarray, shape (N, axes)
        As it would be played, from rest.
    period : int
        Samples per period.
    instruments : Instruments
        Noise of what is recorded.

    Returns
    -------
    Prospect

    Raises
    ------
    InputError
        If there are fewer than two periods.
    UnstableLoopError
        If the model's loop is unstable.
    """
    model = as_model(model)
    record = planned(model, i_e, period, instruments)
    known = model.with_tolerances()
    return Prospect(foreseen(known.opened(), [record], [instruments]), record.seconds)


def planned(model: Model, i_e: FloatArray, period: int, instruments: Instruments) -> Record:
    """The record as it would come without noise."""
    if period < 1 or len(i_e) < 2 * period:
        raise InputError(f"{len(i_e)} samples of i_e, periods of {period}: expected two periods or more")
    record = instruments.of_model(model).simulate(i_e)
    y = record.y if "y" in instruments.signals else np.empty((record.samples, 0))
    return replace(record, period=period, y=y, i_c=record.i_c if "i_c" in instruments.signals else None)
