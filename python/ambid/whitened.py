"""The same least-squares problem as in `problem`, in the yardstick's whitened lines: its cost is J."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ambid.errors import RecordError
from ambid.fit import measured_outputs, recorded_channels
from ambid.loop.assembly import FloatArray
from ambid.model import Model
from ambid.problem import LeastSquares
from ambid.record import Record
from ambid.yardstick import Whitener, Window


class Noise:
    """Noise of y and i_c of several records, from the residual of one model; the same for all models after.

    Attributes
    ----------
    whiteners : list of Whitener
        One per record.
    lines : int
        Number of real numbers that all whitened residuals have: 2 p K summed over the records.
    """

    def __init__(self, model: Model, records: Sequence[Record]) -> None:
        self.records = tuple(records)
        self.whiteners = []
        for record in records:
            if record.period is None or record.periods < 3:
                raise RecordError(
                    f"{record.path or record.name}: {record.periods} periods of the excitation; the misfit in noise "
                    "units needs 3 or more. Record more periods, or state the period."
                )
            window = Window(record.period, record.periods - 1)
            self.whiteners.append(Whitener.from_residual(_residual(model, record), window))
        self.lines = sum(2 * w.factor.shape[0] * w.factor.shape[1] for w in self.whiteners)

    def residual(self, model: Model) -> FloatArray:
        """Whitened measured minus simulated, all records in a row; its sum of squares is J."""
        pairs = zip(self.whiteners, self.records, strict=True)
        return np.concatenate([w.whiten(_residual(model, record)).ravel() for w, record in pairs])

    def change(self, model: Model, base: Model) -> FloatArray:
        """Whitened response of `model` minus that of `base`."""
        found = []
        for w, record in zip(self.whiteners, self.records, strict=True):
            found.append(w.whiten(_simulated(model, record) - _simulated(base, record)).ravel())
        return np.concatenate(found)

    def jacobian(self, model: Model, free: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Whitened residual, and whitened derivative of the response by the parameters in `free`."""
        residuals, columns = [], []
        for w, record in zip(self.whiteners, self.records, strict=True):
            y, slopes = model.loop.sensitivity(model.theta, model.excitation(record), free)
            p = len(recorded_channels(record))
            residuals.append(w.whiten(measured_outputs(record)[:, :p] - y[:, :p]).ravel())
            columns.append(np.column_stack([w.whiten(slopes[:, :p, j]).ravel() for j in range(len(free))]))
        return np.concatenate(residuals), np.vstack(columns)


def _simulated(model: Model, record: Record) -> FloatArray:
    channels = len(recorded_channels(record))
    return model.loop.simulate(model.theta, model.excitation(record))[:, :channels]


def _residual(model: Model, record: Record) -> FloatArray:
    simulated = _simulated(model, record)
    return measured_outputs(record)[:, : simulated.shape[1]] - simulated


class WhitenedProblem(LeastSquares):
    """J as a function of the free parameters."""

    def __init__(
        self, model: Model, noise: Noise, free: list[int], progress: Callable[[int, float], None] | None = None
    ) -> None:
        super().__init__(model, free, progress)
        self.noise = noise

    def _evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        residual, columns = self.noise.jacobian(self.model.with_theta(theta), self.free)
        return columns.T @ columns, -columns.T @ residual, float(residual @ residual)
