"""One record against a model: fits, what is left, and noise, channel by channel."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ambid.arrays import ByValue, ComplexArray, FloatArray
from ambid.channels import unit_of
from ambid.findings import Finding, Kind, Where, WithFindings
from ambid.model import Model
from ambid.noise.noise import Part
from ambid.noise.response_lines import ResponseLines
from ambid.noise.shape import Split
from ambid.record import Measurement, Record
from ambid.results import Named, data_frame


@dataclass(frozen=True)
class ChannelComparison:
    """One channel of one record against the model.

    Attributes
    ----------
    channel : str
        Such as ``y.A_zeta``.
    unit : str
        Of a frequency response m/A or A/A; then all figures are of the complex response, over all its inputs.
    fit_percent, noise_ceiling_percent : float
        Reached, and reachable by the exact model; NaN without enough periods. Of a frequency response every value
        counts in units of its noise: where the loop hardly answers, one that is noise alone would hide all others.
    measured_rms, residual_rms, noise_rms : float
        In `unit`, means over time removed; NaN where the noise is not known.
    misfit : float
        J/dof of this channel alone: 1 when nothing is left but noise; NaN where the noise is not known.
    """

    channel: str
    unit: str
    fit_percent: float
    noise_ceiling_percent: float
    measured_rms: float
    residual_rms: float
    noise_rms: float
    misfit: float

    @property
    def beyond_noise(self) -> float:
        """What is left in units of the noise; as it is where that is not known."""
        return self.residual_rms / self.noise_rms if self.noise_rms > 0.0 else self.residual_rms


@dataclass(frozen=True, repr=False, eq=False)
class RecordComparison(ByValue, WithFindings):
    """One record against the model.

    Attributes
    ----------
    record : Record or FrequencyResponse
    simulated : ndarray, shape (N, channels)
        With the transient that the record begins with; NaN after the last whole period where something disturbs the
        loop that need not repeat. Of a frequency response that of the model, complex, shape (F, outputs, inputs).
    channels : tuple of ChannelComparison
    misfit : float
        J/dof of all channels jointly; NaN where the noise is not known: two periods, too short, or without noise.
    repeatable_share : float
        Part of the excited lines' power that is no noise: ``max(0, (J - dof)/J)``.
    findings : tuple of Finding
        Those of the record; where its noise arises (`arises.NOISE_ARISES`), if that is known; where the model is
        adequate that the noise of a record without periods is not the same in both halves (`halves.UNEVEN`), else that
        more is left than noise which the misfit does not show (`still.LOUDER`, `unseen.OVER_CEILING`).
    """

    record: Measurement
    simulated: FloatArray | ComplexArray
    channels: tuple[ChannelComparison, ...]
    misfit: float
    repeatable_share: float
    findings: tuple[Finding, ...] = ()

    @property
    def worst(self) -> ChannelComparison:
        """The channel of which most is left, in units of its noise."""
        return max(self.channels, key=lambda own: own.beyond_noise)

    @property
    def residual(self) -> FloatArray | ComplexArray:
        """Measured minus simulated, shape of `simulated`; means over time removed."""
        if not self.record.is_in_time:
            return np.asarray(self.record.response - self.simulated)
        left = self.record.outputs
        left -= self.simulated.real
        left -= [float(np.nanmean(channel)) for channel in left.T]
        return left

    @property
    def residual_by_channel(self) -> dict[str, FloatArray | ComplexArray]:
        """The residual of every channel, such as ``y.A_zeta``; of a frequency response of every ``output / input``."""
        names = self.record.channels if self.record.is_in_time else self.record.pairs
        return Named(zip(names, self.residual.reshape(-1, len(names)).T, strict=True))

    def to_pandas(self) -> Any:
        """Convert the residuals to a pandas.DataFrame, `t` [s] or `frequency_hz` before them.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        name, _, values = self.record.abscissa
        return data_frame({name: values, **self.residual_by_channel})

    def __repr__(self) -> str:
        return f"RecordComparison({self.record.name!r}: misfit {self.misfit:.2f}, {len(self.channels)} channels)"

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        fit = with_average({c.channel: c.fit_percent for c in self.channels})
        ceiling = with_average({c.channel: c.noise_ceiling_percent for c in self.channels})
        return {
            "record": self.record.name,
            "fit_percent": fit,
            "noise_ceiling_percent": ceiling,
            "misfit": self.misfit,
            "repeatable_share": self.repeatable_share,
            "channels": [
                {
                    "channel": c.channel,
                    "unit": c.unit,
                    "residual_rms": c.residual_rms,
                    "noise_rms": c.noise_rms,
                    "misfit": c.misfit,
                }
                for c in self.channels
            ],
            **self.findings_as_dict(),
        }


def record_against(model: Model, part: Part) -> RecordComparison:
    """A record whose noise is known."""
    here = part.at(model)
    if not part.is_in_time:
        return _of_response(here, part)
    power = part.noise_power()
    alone = np.mean(np.abs(part.residual_lines(here)) ** 2 / power * part.alone, axis=0)
    white, _, fitted, _ = part.white(here, [])
    free = max(1, part.numbers - fitted)
    joint = float(white @ white) / free
    noise, misfits = np.sqrt(np.mean(power, axis=0)), alone * part.numbers / free
    found = _compared(part.record, part.simulated(here), noise, misfits, joint)
    if part.split is None or not part.record.y.size:
        return found
    points = part.window.points(part.window.excited)
    origin = noise_arises(part.split, points, len(part.record.axes), part.record.name)
    return replace(found, findings=(*found.findings, origin))


def _of_response(here: Model, part: ResponseLines) -> RecordComparison:
    """A frequency response, each channel over all its inputs."""
    record, simulated = part.record, part.simulated(here)
    left, white = record.response - simulated, part.white(here, []).residual
    of = "m" if all(name.startswith("r.") for name in record.inputs) else "A"
    rows = []
    for k, channel in enumerate(record.outputs):
        std = record.std[:, k]
        tables = np.abs(record.response[:, k]), np.abs(left[:, k]), std
        measured, residual, noise = (_rms(own) for own in tables)
        in_noise, missed, _ = (_rms(own / std) for own in tables)
        rows.append(
            ChannelComparison(
                channel=channel,
                unit=f"{unit_of(channel)}/{of}",
                fit_percent=100.0 * (1.0 - missed / in_noise),
                noise_ceiling_percent=100.0 * (1.0 - 1.0 / in_noise),
                measured_rms=measured,
                residual_rms=residual,
                noise_rms=noise,
                misfit=missed**2,
            )
        )
    joint = float(white @ white) / part.judged
    return RecordComparison(record, simulated, tuple(rows), joint, float(np.maximum(0.0, 1.0 - 1.0 / joint)))


def _rms(values: FloatArray) -> float:
    """Root of the mean square of those that are known."""
    return float(np.sqrt(np.nanmean(values**2)))


def unjudged(model: Model, record: Measurement) -> RecordComparison:
    """A record whose noise is not known, against a response from rest."""
    if not record.is_in_time:
        return _of_response(model.at(record), ResponseLines(record, model))
    unknown = np.full(len(record.channels), np.nan)
    return _compared(record, model.response(record)[:, : len(unknown)], unknown, unknown, np.nan)


def _compared(
    record: Record, simulated: FloatArray, noise_rms: FloatArray, misfits: FloatArray, joint: float
) -> RecordComparison:
    rows, columns = [], record.columns()
    for k, channel in enumerate(record.channels):
        measured = columns[channel]
        left = measured - simulated[:, k]
        known = np.isfinite(left)
        residual, deviation = float(left[known].std()), float(measured[known].std())
        rows.append(
            ChannelComparison(
                channel=channel,
                unit=unit_of(channel),
                fit_percent=100.0 * (1.0 - residual / deviation),
                noise_ceiling_percent=100.0 * (1.0 - float(noise_rms[k]) / deviation),
                measured_rms=deviation,
                residual_rms=residual,
                noise_rms=float(noise_rms[k]),
                misfit=float(misfits[k]),
            )
        )
    return RecordComparison(record, simulated, tuple(rows), joint, float(np.maximum(0.0, 1.0 - 1.0 / joint)))


def with_average(per_channel: dict[str, float]) -> dict[str, float]:
    """Add ``average`` over the displacements y; over all channels where there are none."""
    of_y = [value for channel, value in per_channel.items() if channel.startswith("y.")]
    return Named({**per_channel, "average": float(np.mean(of_y or list(per_channel.values())))})


def averaged_over(percent: Mapping[str, float]) -> str:
    """What an ``average`` is over, in words."""
    return "y" if any(channel.startswith("y.") for channel in percent) else "all"


NOISE_ARISES = Kind(
    "noise_arises",
    "note",
    "noise of y: {heard_m:.3g|nm} heard by the controller, {recorder_m:.3g|nm} of the recorder"
    "[, {either_m:.3g|nm} of either][; noise of i_c: {heard_a:.3g|mA} heard, {recorder_a:.3g|mA} of the recorder]"
    "[, {either_a:.3g|mA} of either]",
)
"""Rms as recorded, what is heard once round the loop, in the mean over all axes. What may be either is of frequencies
at which the loop leaves noise as it is. That of i_c where the controller reads it."""
LEAST = 0.1
"""Part of the power that may be either, to be reported."""


def noise_arises(split: Split, points: ComplexArray, axes: int, record: str) -> Finding:
    """What noise is heard by the controller and what is not, by its mean over lines that are spread evenly.

    Parameters
    ----------
    split : Split
    points : ndarray of complex
        Of the lines, on the unit circle.
    axes : int
    record : str
        Its name.
    """
    values: dict[str, Any] = {}
    for unit, own in (("m", slice(0, axes)), ("a", slice(axes, None))):
        powers = [float(np.mean(power[:, own])) for power in split.shown(points) if power[:, own].size]
        if powers:
            heard, recorder, either = np.sqrt(powers).tolist()
            is_clear = either**2 > LEAST * sum(powers)
            values |= {f"heard_{unit}": heard, f"recorder_{unit}": recorder}
            values[f"either_{unit}"] = either if is_clear else None
    return NOISE_ARISES(Where(record=record), **values)
