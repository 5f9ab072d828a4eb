"""Errors of the record alone, beside the physics: channels that are late, scaled, of opposite sign or exchanged.

Named, they say that the record is wrong, and not what the model knows of the machine. What the controller reads is
right: a scale that it reads, too, is `sensor_gain_error`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.effects.sensor import REACH
from ambid.effects.slips import LEAST, MOST
from ambid.effects.traits import GAIN_OF_ANSWER, GAIN_OF_READING, LAG_OF_READING
from ambid.findings import Finding, Kind, Where
from ambid.loop.effect import Effect, EffectParameter, Seen, Trait
from ambid.loop.plant import Plant
from ambid.record import Record
from ambid.record.shifting import shifted
from ambid.rig import Rig

SIGNALS = ("y", "i_c", "i_e")
UNITS = 1e7
"""Factor by which a scale may be wrong, such as micrometres that are taken for metres."""
RECORD = "the record is wrong, and not the physics of the model"
EXCITATION = Kind(
    "excitation_scale_wrong",
    "warning",
    "the data ask for {factor:.4g} times the excitation that was recorded: i_e of the record is wrong, and not the "
    "physics of the model",
    "correct the scale of i_e",
)
EXCITATION_MAY_BE = Kind(
    "excitation_scale_may_be_wrong",
    "warning",
    "{effect}, which explains the data as well, would mean that i_e of the record is wrong, and not the physics of the "
    "model",
)
CHANNEL_LATE = Kind(
    "channel_late",
    "warning",
    "the data ask for {signal} recorded {delay_s:.4g|us} ({delay_samples:.3g} samples) after all others: the record is "
    "wrong, and not the physics of the model",
    "shift {signal} by that time, or give all cards one trigger",
)
CHANNEL_MAY_BE_LATE = Kind(
    "channel_may_be_late",
    "warning",
    "{effect}, which explains the data as well, would mean that {signal} is recorded late or early, and not that the "
    "physics of the model is wrong",
)
SCALED = Kind(
    "channel_scaled",
    "warning",
    f"{{channel}} is recorded {{factor:.4g}} times too large: {RECORD}",
    "divide {channel} by that",
)
REVERSED = Kind("channel_reversed", "warning", f"{{channel}} is recorded with opposite sign: {RECORD}", "turn its sign")
EXCHANGED = Kind(
    "channels_recorded_exchanged",
    "warning",
    f"{{first}} and {{second}} are exchanged: {RECORD}",
    "exchange the names of the two columns",
)
RECORD_MAY_BE_WRONG = Kind(
    "record_may_be_wrong",
    "warning",
    "{effect}, which explains the data as well, would mean that {channel} of the record is wrong, and not the physics "
    "of the model",
)


class _OfRecord(Effect):
    """An error of the record, which the machine does not have; one without a number of its own is there or not."""

    within_command = True
    in_record = True

    def why_not(self, rig: Rig) -> str:
        """It makes sense on every rig."""
        return ""

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """None: it is there or not."""
        return []

    def probes(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Itself, where it has no number."""
        return super().probes(rig) or [{}]

    def amplitudes(self, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        """All of it, where it has no number."""
        low, high = super().amplitudes(rig)
        return (low, high) if len(low) else (np.ones(1), np.ones(1))

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """Nothing, where it has no number."""
        return super().start(rig, amplitudes) if self.parameters(rig) else {}


@dataclass(frozen=True)
class ExcitationGainError(_OfRecord):
    """A scale of the excitation that differs from the record's, on all axes alike."""

    name = "excitation_gain_error"
    physics = "a slip: the excitation that acts is larger or smaller than the record says"
    equation = "i_ref = -K y + (1 + e) i_e"
    signature = "y and i_c too large or too small by one factor at all frequencies, in a loop whose poles are right"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative error of the scale of i_e."""
        return [EffectParameter("scale", "1", 0.05, LEAST, MOST, "relative error of the scale of i_e in the record")]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """The scale."""
        return {GAIN_OF_ANSWER: values["scale"]}

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """The scale that the data ask for."""
        if values is None:
            return [EXCITATION_MAY_BE(Where(channel="i_e"), effect=self.name)]
        return [EXCITATION(Where(channel="i_e"), factor=1.0 + values["scale"])]

    def attach(self, plant: Plant) -> None:
        """The same on every axis."""
        plant.scale_excitation(self.slot("scale"))

    def mended(self, record: Record, values: Mapping[str, float]) -> Record:
        """i_e as it acts."""
        return _with(record, "i_e", lambda x: (1.0 + values["scale"]) * x)


@dataclass(frozen=True)
class ChannelDelay(_OfRecord):
    """A kind of channel that is recorded late or early against all others; of i_c that is `SamplingSkew`.

    Attributes
    ----------
    signal : str
        ``y`` or ``i_e``.
    """

    name = "channel_delay"
    physics = "a slip: a card records its channels late, or early, against those of the others"
    equation = "y(t) = y_true(t - d); of i_e all others are early by d"
    signature = (
        "a phase in proportion to the frequency in y alone, or in y and i_c alike, in a loop whose poles are right"
    )
    source = "Pintelon, Schoukens, System Identification, 2nd ed., section 2.7"

    signal: str = "y"

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """The displacements late, or the excitation."""
        return [ChannelDelay(signal) for signal in ("y", "i_e")]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """By how much the channel is late [s]."""
        sample = 1.0 / rig.sample_rate
        meaning = f"by how much {self.signal} is recorded late, d; negative where it is early"
        return [EffectParameter("delay", "s", 0.02 * sample, -REACH * sample, REACH * sample, meaning)]

    def far_starts(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Every whole sample: a phase that turns round is no longer in proportion to the delay."""
        whole = range(1, int(REACH))
        return [{"delay": sign * k / rig.sample_rate} for k in whole for sign in (1.0, -1.0)]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """A lag of the readings."""
        return {LAG_OF_READING: values["delay"]} if self.signal == "y" else {}

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """The delay that the data ask for."""
        where = Where(channel=self.signal)
        if values is None:
            return [CHANNEL_MAY_BE_LATE(where, effect=self.name, signal=self.signal)]
        delay = values["delay"]
        return [CHANNEL_LATE(where, signal=self.signal, delay_s=delay, delay_samples=delay * rig.sample_rate)]

    def attach(self, plant: Plant) -> None:
        """Exact; against i_e that is late, y and i_c are early."""
        outputs, scale = (("y",), 1.0) if self.signal == "y" else (("y", "i_c"), -1.0)
        for output in outputs:
            for axis in plant.axes:
                plant.record_late(f"{output}.{axis}", self.slot("delay"), scale)

    def mended(self, record: Record, values: Mapping[str, float]) -> Record:
        """y moved by the delay; against i_e that is late, y and i_c the other way."""
        late = values["delay"] * record.sample_rate
        return shifted(record, ("y",), -late) if self.signal == "y" else shifted(record, ("y", "i_c"), late)


@dataclass(frozen=True)
class ChannelGain(_OfRecord):
    """A scale of one recorded channel, or of y or i_c of all axes; of i_e of all axes that is `ExcitationGainError`.

    Attributes
    ----------
    channel : str
        Such as ``y`` of all axes, or ``i_c.A_zeta``.
    """

    name = "channel_gain"
    physics = (
        "a slip: a channel is recorded with another scale than the record says, which the controller does not read"
    )
    equation = "y = (1 + g) y_true, or i_c = (1 + g) i_c_true; of i_e (1 + g) i_e acts"
    signature = "one channel too large or too small by one factor at all frequencies, in a loop whose poles are right"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"

    channel: str = "y"

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Each channel, and y or i_c of all axes."""
        return [ChannelGain(channel) for channel in _channels(seen.rig) if channel != "i_e"]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative error of the scale."""
        meaning = f"relative error g of the scale of {self.channel}"
        return [EffectParameter("gain", "1", 0.05, 1.0 / UNITS - 1.0, UNITS, meaning)]

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """All of what the residual calls for: the record is linear in it."""
        (own,), (amplitude,) = self.parameters(rig), amplitudes
        return {"gain": float(np.clip(amplitude * own.probe, own.lower, own.upper))}

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """An error of a reading, or a gain of the answer."""
        of = {"y": GAIN_OF_READING, "i_e": GAIN_OF_ANSWER}.get(self.channel.split(".")[0])
        return {of: values["gain"]} if of else {}

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """The factor that the record has to be divided by."""
        where = Where(channel=self.channel)
        if values is None:
            return [RECORD_MAY_BE_WRONG(where, effect=self.name, channel=self.channel)]
        return [SCALED(where, channel=self.channel, factor=self._factor(values))]

    def attach(self, plant: Plant) -> None:
        """In the record alone, exact."""
        signal, axes = _signal_and_axes(self.channel, plant.rig)
        if signal == "i_e":
            plant.scale_excitation(self.slot("gain"), axes)
        else:
            for axis in axes:
                plant.scale(f"recorded.{signal}.{axis}", self.slot("gain"))

    def mended(self, record: Record, values: Mapping[str, float]) -> Record:
        """Divided by the factor."""
        signal, axes = _signal_and_axes(self.channel, record)
        own = np.isin(record.axes, axes)
        return _with(record, signal, lambda x: np.where(own, x / self._factor(values), x))

    def _factor(self, values: Mapping[str, float]) -> float:
        """By which the record is too large."""
        factor = 1.0 + values["gain"]
        return 1.0 / factor if self.channel.startswith("i_e") else factor


@dataclass(frozen=True)
class ChannelSign(_OfRecord):
    """One recorded channel, or a signal of all axes, with opposite sign.

    Attributes
    ----------
    channel : str
        Such as ``y`` of all axes, or ``i_c.A_zeta``.
    """

    name = "channel_sign"
    physics = "a slip: a channel is recorded with opposite sign, which the controller does not read"
    equation = "y = -y_true, or i_c = -i_c_true; of i_e -i_e acts"
    signature = "one channel has the right size and the opposite phase at all frequencies"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"

    channel: str = "y"

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Each channel, and each signal of all axes."""
        return [ChannelSign(channel) for channel in _channels(seen.rig)]

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """The channel to be turned."""
        where = Where(channel=self.channel)
        if values is None:
            return [RECORD_MAY_BE_WRONG(where, effect=self.name, channel=self.channel)]
        return [REVERSED(where, channel=self.channel)]

    def attach(self, plant: Plant) -> None:
        """In the record alone."""
        signal, axes = _signal_and_axes(self.channel, plant.rig)
        turned = np.diag(np.where(np.isin(plant.axes, axes), -1.0, 1.0))
        plant.mix("reversed", signal, turned)

    def mended(self, record: Record, values: Mapping[str, float]) -> Record:
        """Turned back."""
        signal, axes = _signal_and_axes(self.channel, record)
        own = np.isin(record.axes, axes)
        return _with(record, signal, lambda x: np.where(own, -x, x))


@dataclass(frozen=True)
class ChannelsExchanged(_OfRecord):
    """A signal of two axes, each recorded in the place of the other.

    Attributes
    ----------
    signal : str
        ``y``, ``i_c`` or ``i_e``.
    first, second : str
        Axes; empty for the first two of the rig.
    """

    name = "channels_exchanged"
    physics = "a slip: the channels of two axes are exchanged in the record"
    plural = True
    equation = "y_1 = y_2_true, y_2 = y_1_true; likewise i_c; of i_e the other one acts"
    signature = "what one axis is expected to show stands in the channel of another, and back"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"

    signal: str = "y"
    first: str = ""
    second: str = ""

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Every two axes, of every signal."""
        pairs = list(combinations(seen.rig.axes, 2))
        return [ChannelsExchanged(signal, *pair) for signal in SIGNALS for pair in pairs]

    def why_not(self, rig: Rig) -> str:
        """A rig of one axis."""
        return "" if len(rig.axes) > 1 else "there is one axis only"

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """The two channels."""
        first, second = (f"{self.signal}.{axis}" for axis in self._pair(rig.axes))
        if values is None:
            return [RECORD_MAY_BE_WRONG(Where(channel=first), effect=self.name, channel=f"{first} or {second}")]
        return [EXCHANGED(Where(channel=first), first=first, second=second)]

    def attach(self, plant: Plant) -> None:
        """In the record alone."""
        plant.mix("exchanged", self.signal, self._order(plant.axes))

    def mended(self, record: Record, values: Mapping[str, float]) -> Record:
        """Exchanged back."""
        return _with(record, self.signal, lambda x: x @ self._order(record.axes))

    def _pair(self, axes: Sequence[str]) -> tuple[str, str]:
        return self.first or axes[0], self.second or axes[1]

    def _order(self, axes: Sequence[str]) -> FloatArray:
        """The matrix that exchanges them, which is its own inverse."""
        order = list(range(len(axes)))
        a, b = (list(axes).index(axis) for axis in self._pair(axes))
        order[a], order[b] = b, a
        return np.eye(len(axes))[order]


def _channels(rig: Rig) -> list[str]:
    """Every signal of all axes, then each axis of it where there are several."""
    each = rig.axes if len(rig.axes) > 1 else ()
    return [channel for signal in SIGNALS for channel in (signal, *(f"{signal}.{axis}" for axis in each))]


def _signal_and_axes(channel: str, among: Rig | Record) -> tuple[str, Sequence[str]]:
    """The signal of a channel, and its axes."""
    signal, _, axis = channel.partition(".")
    return signal, [axis] if axis else among.axes


def _with(record: Record, signal: str, change: Any) -> Record:
    """The record with a signal changed, where it has it."""
    own = getattr(record, signal)
    return record if own is None else replace(record, **{signal: change(own)})


EFFECTS = (
    ExcitationGainError(),
    ChannelDelay(),
    ChannelGain(),
    ChannelSign(),
    ChannelsExchanged(),
)
