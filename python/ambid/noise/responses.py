"""Measured frequency responses beside those of models, such as before and after an effect: the numbers of a figure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ambid.arrays import ByValue, ComplexArray, FloatArray
from ambid.errors import InputError
from ambid.model import Model
from ambid.noise.compared import RecordComparison
from ambid.noise.comparison import Comparison
from ambid.noise.response_lines import ResponseLines
from ambid.record import FrequencyResponse, Record
from ambid.results import Tabular, band_text, plain


@dataclass(frozen=True, eq=False)
class Modelled(ByValue):
    """Frequency responses of one model.

    Attributes
    ----------
    name : str
        Its effects, or ``base model``.
    at_measured : ndarray of complex, shape (F, outputs, inputs)
        At the measured frequencies.
    frequency_hz : ndarray, shape (D,)
        Measured frequencies and others between them; of a nonlinear model the measured ones alone.
    response : ndarray of complex, shape (D, outputs, inputs)
    """

    name: str
    at_measured: ComplexArray
    frequency_hz: FloatArray
    response: ComplexArray


@dataclass(frozen=True, repr=False, eq=False)
class Responses(ByValue, Tabular):
    """Frequency responses of one record, measured and modelled; result of `frequency_responses`.

    Attributes
    ----------
    measured : FrequencyResponse
        With the std of every value.
    modelled : tuple of Modelled
        The model that is looked at, then those before it.
    """

    measured: FrequencyResponse
    modelled: tuple[Modelled, ...]

    def left(self, which: int = 0) -> FloatArray:
        """Power of measured less modelled over that of the noise, shape (F, outputs, inputs): 1 is noise alone."""
        apart = np.abs(self.measured.response - self.modelled[which].at_measured)
        return np.asarray((apart / self.measured.std) ** 2)

    @property
    def worst(self) -> tuple[str, str]:
        """The output and the input whose pair the model before all others, or the only one, misses most."""
        mean = np.nanmean(self.left(-1), axis=0)
        o, i = np.unravel_index(int(np.nanargmax(mean)), mean.shape)
        return self.measured.outputs[o], self.measured.inputs[i]

    def place(self, output: str, inlet: str) -> tuple[int, int]:
        """Where a pair stands in the tables.

        Raises
        ------
        InputError
            If there is no such pair.
        """
        if output not in self.measured.outputs or inlet not in self.measured.inputs:
            raise InputError(
                f"{self.measured.name}: no pair {output} / {inlet}; it has {', '.join(self.measured.pairs)}"
            )
        return self.measured.outputs.index(output), self.measured.inputs.index(inlet)

    def table(self) -> dict[str, list[Any]]:
        """A row each measured pair: frequencies, and the mean of `left` of every model."""
        pairs = [
            (o, i) for o, i in np.ndindex(*self.measured.measured.shape[1:]) if self.measured.measured[:, o, i].any()
        ]
        columns: dict[str, list[Any]] = {
            "output": [self.measured.outputs[o] for o, _ in pairs],
            "input": [self.measured.inputs[i] for _, i in pairs],
            "frequencies": [int(self.measured.measured[:, o, i].sum()) for o, i in pairs],
        }
        return columns | {
            f"misfit of {own.name}": [float(np.nanmean(self.left(k)[:, o, i])) for o, i in pairs]
            for k, own in enumerate(self.modelled)
        }

    def summary(self) -> list[str]:
        """What was measured, and by which models it is modelled."""
        f, models = self.measured.frequency_hz, ", ".join(own.name for own in self.modelled)
        return [f"{self.measured.name}: {len(f)} frequencies, {band_text(f[0], f[-1])} Hz; {models}"]

    def to_json(self) -> dict[str, Any]:
        """Plain data: measured, its std, and every model at the measured frequencies; complex numbers are [re, im]."""
        measured, (last, *before) = self.measured, self.modelled
        return plain(
            {
                "record": measured.name,
                "frequency_hz": measured.frequency_hz.tolist(),
                "outputs": list(measured.outputs),
                "inputs": list(measured.inputs),
                "response": measured.response.tolist(),
                "std": measured.std.tolist(),
                "model": last.at_measured.tolist(),
                "before": [{"name": own.name, "model": own.at_measured.tolist()} for own in before],
            }
        )


def frequency_responses(comparison: Comparison, record: int = 0, before: Sequence[Model] = ()) -> Responses:
    """Measured and modelled frequency responses of one record, each excitation to each output.

    Of a record in time the measured ones are `Record.frequency_response`. Of a linear model the response is exact; a
    nonlinear one is asked what the record is asked: its simulated signals are taken for a record.

    Parameters
    ----------
    comparison : Comparison
    record : int
        Which of the records.
    before : sequence of Model
        Further models, such as the one without the effect.

    Raises
    ------
    InputError
        If there is no such record.
    RecordError
        If the record is too short for a frequency response, or holds no excitation.
    """
    count = len(comparison.records)
    if not 0 <= record < count:
        raise InputError(f"record = {record}: expected 0 to {count - 1}, the comparison has {count}")
    own = comparison.records[record]
    measured = own.record.frequency_response()
    found = [_modelled(comparison.model, own, measured)]
    for model in before:
        other = comparison.of(model) if comparison.is_judged else Comparison(model, [own.record])
        found.append(_modelled(model, other.records[record if comparison.is_judged else 0], measured))
    return Responses(measured, tuple(found))


def _modelled(model: Model, own: RecordComparison, measured: FrequencyResponse) -> Modelled:
    name = " + ".join(effect.name for effect in model.effects) or "base model"
    here, f = model.at(own.record), measured.frequency_hz
    if own.record.is_in_time and not here.is_linear:
        response = _of_signals(own.record, np.asarray(own.simulated, dtype=np.float64))
        return Modelled(name, response, f, response)
    # frequencies at which a linear model is shown beside the measured ones: its modes appear between them
    dense = np.union1d(f, np.geomspace(f[0], f[-1], 800))
    nothing = np.zeros((len(dense), len(measured.outputs), len(measured.inputs)), dtype=complex)
    asked = replace(measured, frequency_hz=dense, response=nothing, std=nothing.real + 1.0, covariance=None)
    response = ResponseLines(asked, model).simulated(here)
    return Modelled(name, response[np.searchsorted(dense, f)], dense, response)


def _of_signals(record: Record, simulated: FloatArray) -> ComplexArray:
    """What a record with these outputs would show, at the same frequencies."""
    return record.with_outputs(simulated).frequency_response().response
