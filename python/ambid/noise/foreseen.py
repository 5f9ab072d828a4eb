"""The noise of a record that is not made yet: as instruments are said to have it, or as another record had it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import InputError, RecordError
from ambid.model import Model
from ambid.noise.colour import back_through_loop
from ambid.noise.comparison import Comparison
from ambid.noise.lines import RecordLines
from ambid.noise.measured import Measured
from ambid.noise.noise import Noise
from ambid.noise.whitener import Spectrum
from ambid.record import Record
from ambid.record.checks import SMALLEST_CHANGE
from ambid.rig.fields import LARGEST_VALUE


@dataclass(frozen=True, eq=False)
class Instruments:
    """The noise that the instruments of a machine bring, before it goes round the loop.

    Attributes
    ----------
    frequency_hz : ndarray, shape (F,)
        Rising.
    covariance : ndarray, shape (F, p, p)
        Of `signals` of every axis each, then of `further`, of each sample if it were white [m^2, m A, A^2, ...].
    further : tuple of str
        Channels beyond y and i_c of the axes, such as ``b.A_zeta``.
    signals : tuple of str
        Of y and i_c, those that are recorded; of every axis.
    """

    frequency_hz: FloatArray
    covariance: ComplexArray
    further: tuple[str, ...] = ()
    signals: tuple[str, ...] = ("y", "i_c")

    @property
    def channels(self) -> int:
        """Number p of all channels."""
        return self.covariance.shape[1]

    def names(self, axes: Sequence[str]) -> tuple[str, ...]:
        """Names of the channels on a rig with these axes.

        Raises
        ------
        InputError
            If they are not as many as the covariance has.
        """
        found = (*(f"{signal}.{axis}" for signal in self.signals for axis in axes), *self.further)
        if len(found) != self.channels:
            raise InputError(
                f"the noise of {self.channels} channels is given; expected that of the {len(found)} channels "
                f"{', '.join(found)}"
            )
        return found

    def of_model(self, model: Model) -> Model:
        """A model whose first outputs are the channels."""
        return model.recorded_as(self.names(model.rig.axes))

    @classmethod
    def stated(
        cls,
        axes: int,
        sensor_noise: float,
        current_noise: float | None,
        further: Mapping[str, float] | None = None,
    ) -> Instruments:
        """White noise on every displacement [m rms] and recorded current [A rms]; None where i_c is not recorded.

        `further` has the rms of each further channel by its name, in its unit.

        Raises
        ------
        InputError
            If a noise is zero, or so small or large that its power is none in floating point: nothing can be foreseen.
        """
        levels = {"sensor_noise": sensor_noise} | ({} if current_noise is None else {"current_noise": current_noise})
        beyond = dict(further or {})
        for name, rms in {**levels, **beyond}.items():
            _require_noise(name, rms)
        power = np.append(np.repeat([rms**2 for rms in levels.values()], axes), [rms**2 for rms in beyond.values()])
        return cls(np.zeros(1), np.diag(power).astype(complex)[None], tuple(beyond), ("y", "i_c")[: len(levels)])

    @classmethod
    def of(cls, comparison: Comparison) -> Instruments:
        """As the first record in time of a comparison had it, taken back through the loop of its model.

        Raises
        ------
        RecordError
            If there is none, or it has no periods.
        """
        part = next((own for own in comparison.noise.in_time if own.window.is_periodic), None)
        if part is None:
            raise RecordError(
                "none of the records has periods, and without them noise is not separated from misfit; give one "
                "whose excitation repeats, or state the noise"
            )
        count = len(part.window.excited)
        back = back_through_loop(part.unexcited.base, part.points[:count], part.measured.channels)
        root = back @ _core.inverses(np.ascontiguousarray(part.whitening[:count]))
        covariance = 2.0 * root @ root.conj().transpose(0, 2, 1) / part.spectrum.raised[:count, None, None]
        record = part.record
        signals = tuple(name for name in ("y", "i_c") if f"{name}.{record.axes[0]}" in record.channels)
        return cls(part.frequency_hz, covariance, tuple(record.further), signals)

    def beside(self, noise: Mapping[str, float]) -> Instruments:
        """The same where more is recorded, in white noise.

        Parameters
        ----------
        noise : mapping of str to float
            Rms of a signal of every axis, ``y`` or ``i_c``, or of a further channel, such as ``b.A_zeta``.

        Raises
        ------
        InputError
            If a noise is not above zero, or there is one already.
        """
        for name, rms in noise.items():
            _require_noise(name, rms)
            if name in (*self.signals, *self.further):
                raise InputError(f"{name} = {rms!r}: its noise is known already; leave it out")
        signals = tuple(name for name in ("y", "i_c") if name in (*self.signals, *noise))
        further = (*self.further, *(name for name in noise if name not in signals))
        axes = range((self.channels - len(self.further)) // len(self.signals))
        names = [*((signal, axis) for signal in signals for axis in axes), *((name, 0) for name in further)]
        covariance = np.zeros((len(self.covariance), len(names), len(names)), dtype=complex)
        had = [k for k, (name, _) in enumerate(names) if name not in noise]
        covariance[:, np.array(had)[:, None], had] = self.covariance
        for k, (name, _) in enumerate(names):
            covariance[:, k, k] += noise.get(name, 0.0) ** 2
        return Instruments(self.frequency_hz, covariance, further, signals)

    def without(self, *names: str) -> Instruments:
        """The same where less is recorded: no ``i_c``, of all axes, or no further channels, by their names."""
        axes = (self.channels - len(self.further)) // len(self.signals)
        own = [*(signal for signal in self.signals for _ in range(axes)), *self.further]
        kept = np.array([k for k, name in enumerate(own) if name not in names])
        signals, further = ([name for name in some if name not in names] for some in (self.signals, self.further))
        return Instruments(self.frequency_hz, self.covariance[:, kept[:, None], kept], tuple(further), tuple(signals))

    def without_currents(self) -> Instruments:
        """The same where i_c is not recorded."""
        return self.without("i_c")

    def averaged(self, times: float) -> Instruments:
        """Noise of the mean of so many records, which shows as much as one that is so many times as long."""
        return replace(self, covariance=self.covariance / times)

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Covariance at frequencies, shape (frequencies, p, p): between its own ones straight, beyond them constant."""
        after = np.searchsorted(self.frequency_hz, frequency_hz)
        low, high = np.maximum(after - 1, 0), np.minimum(after, len(self.frequency_hz) - 1)
        width = self.frequency_hz[high] - self.frequency_hz[low]
        share = np.where(width > 0.0, (frequency_hz - self.frequency_hz[low]) / np.where(width > 0.0, width, 1.0), 0.0)
        share = np.clip(share, 0.0, 1.0)[:, None, None]
        return np.asarray((1.0 - share) * self.covariance[low] + share * self.covariance[high])


def _require_noise(name: str, rms: float) -> None:
    if not SMALLEST_CHANGE <= rms <= LARGEST_VALUE:
        raise InputError(
            f"{name} = {rms!r}: expected an rms from {SMALLEST_CHANGE:g} to {LARGEST_VALUE:g}, in its SI unit"
        )


class ForeseenLines(RecordLines):
    """The judged lines of a simulated record, in noise that is known beforehand."""

    def __init__(self, model: Model, record: Record, instruments: Instruments) -> None:
        self._instruments = instruments
        super().__init__(model, Measured(record))

    def _between(self) -> Spectrum:
        back = back_through_loop(self._base, self.points, self.measured.channels)
        at = self.index * self.record.sample_rate / self.window.samples
        return Spectrum.of(self._instruments.at(at), back, np.ones(len(self.points)))


def foreseen(model: Model, records: Sequence[Record], instruments: Sequence[Instruments]) -> Comparison:
    """Hold a model against simulated records with periods, in noise that is known beforehand.

    Parameters
    ----------
    model : Model
    records : sequence of Record
        Without noise, two periods each or more, with the channels of the instruments.
    instruments : sequence of Instruments
        Of each record.
    """
    model = model.covering(records)
    parts = [ForeseenLines(model, record, own) for record, own in zip(records, instruments, strict=True)]
    return Comparison(model, records, Noise.of_parts(parts))
