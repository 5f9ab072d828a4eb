"""The one yardstick: noise of y and i_c of several records, and whitened lines whose sum of squares is J."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.colour import loop_noise
from ambid.noise.tones import find_tones, without_tones
from ambid.noise.whitener import Whitener
from ambid.noise.window import Window
from ambid.record import Record


class Noise:
    """Noise of y and i_c of several records, from the residual of one model; the same for all models after.

    Tones of the residual are no noise: they are taken out of it, and the lines around them, and around the frequencies
    of effects in the model, are judged beside the excited ones.

    Attributes
    ----------
    records : tuple of Record
    tones : list of tuple of Tone
        Of each record.
    whiteners : list of Whitener
        One per record.
    lines : int
        Number of real numbers that all whitened residuals have: 2 p per line, summed over the records.
    """

    def __init__(self, model: Model, records: Sequence[Record]) -> None:
        self.records = tuple(records)
        self.tones, self.whiteners = [], []
        for record in records:
            window = Window.of(record)
            residual, rate, here = _residual(model, record), record.sample_rate, model.at(record)
            way = loop_noise(here, window.samples, residual.shape[1])
            shape = np.asarray(np.linalg.inv(way), dtype=np.complex128)
            tones: tuple[Tone, ...] = ()
            if record.periods > 3:
                tones = find_tones(residual, window, rate, len(record.axes), here.rig.speed, shape)
            quiet = without_tones(residual, tones, window, rate)
            self.tones.append(tones)
            own = [f for effect in here.acting for f in effect.frequencies_hz(here.rig)]
            more = _around([*own, *(tone.frequency_hz for tone in tones)], window, rate)
            i_e = model.excitation(record)[:, : len(record.axes)]
            self.whiteners.append(Whitener.from_residual(quiet, window, i_e, more, shape))
        self.lines = sum(w.numbers for w in self.whiteners)

    @property
    def spreads(self) -> FloatArray:
        """Variance of each whitened number on the direction of a whitened response, see `Whitener`."""
        return np.concatenate([w.spreads for w in self.whiteners])

    def residual(self, model: Model) -> FloatArray:
        """Whitened measured minus simulated, all records in a row; its sum of squares is J."""
        pairs = zip(self.whiteners, self.records, strict=True)
        return np.concatenate([w.whiten(_residual(model, record)) for w, record in pairs])

    def by_record(self, white: FloatArray) -> list[FloatArray]:
        """Whitened numbers of all records, record by record."""
        return np.split(white, np.cumsum([w.numbers for w in self.whiteners])[:-1])

    def response(self, model: Model) -> FloatArray:
        """Whitened simulated response."""
        pairs = zip(self.whiteners, self.records, strict=True)
        return np.concatenate([w.whiten(_simulated(model, record)) for w, record in pairs])

    def settled_response(self, model: Model, settling: float) -> FloatArray:
        """The same but for the transient, from as few periods as it takes to settle; for scores.

        Parameters
        ----------
        model : Model
        settling : float
            Time after which the transient no longer matters [s].
        """
        found = []
        for w, record in zip(self.whiteners, self.records, strict=True):
            window, here = w.window, model.at(record)
            periods = 1 + int(np.ceil(settling * record.sample_rate / window.period))
            inputs = here.excitation(record)
            is_disturbed = inputs.shape[1] > len(record.axes)  # by what need not repeat with the excitation
            if is_disturbed or not window.is_periodic or periods > window.periods:
                found.append(w.whiten(_simulated(model, record)))
            else:
                samples = periods * window.period
                signal = here.loop.simulate(here.theta, inputs[:samples])
                found.append(w.whiten_period(signal[-window.period :, : len(record.channels)]))
        return np.concatenate(found)

    def jacobian(self, model: Model, free: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Whitened residual, and whitened derivative of the response by the parameters in `free`."""
        residuals, columns = [], []
        for w, record in zip(self.whiteners, self.records, strict=True):
            y, slopes = model.sensitivity(record, free)
            p = len(record.channels)
            residuals.append(w.whiten(record.outputs - y[:, :p]))
            columns.append(w.whiten(slopes[:, :p]))
        return np.concatenate(residuals), np.vstack(columns)


def _around(frequencies_hz: Sequence[float], window: Window, sample_rate: float) -> NDArray[np.intp]:
    """The unexcited lines next to tones."""
    at = [frequency * window.samples / sample_rate for frequency in frequencies_hz]
    near = {line for place in at for line in range(int(place) - 1, int(place) + 3)}
    inside = (line for line in near if 0 < line < window.samples // 2 and line % window.periods)
    return np.array(sorted(inside), dtype=np.intp)


def _simulated(model: Model, record: Record) -> FloatArray:
    return model.response(record)[:, : len(record.channels)]


def _residual(model: Model, record: Record) -> FloatArray:
    return record.outputs - _simulated(model, record)
