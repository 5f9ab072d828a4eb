"""Effects in the recording: channels that are read, or stored, at other instants than the record says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ambid.effects.traits import LAG_OF_CURRENT, LAG_OF_READING, LAG_ROUND_LOOP
from ambid.findings import Finding, Kind, Where
from ambid.loop.effect import Effect, EffectParameter, Seen, Trait
from ambid.loop.plant import Plant
from ambid.rig import Rig

REACH = 20.0
"""Samples by which a reading may be late or early."""
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


@dataclass(frozen=True)
class SamplingSkew(Effect):
    """Currents and displacements read at different instants.

    Attributes
    ----------
    moves_y : bool
        Whether a digital controller, and the record, read y before the controller's output changes.
    """

    name = "sampling_skew"
    physics = "currents and displacements are not read at one instant, nor when a digital controller's output changes"
    equation = "i_c(t) = i_a(t + d), y(t) = y_true(t - e)"
    signature = "i_c alone is late, y fits; where the controller uses an early y, the loop loses damping as well"
    source = "Pintelon, Schoukens, System Identification, 2nd ed., section 2.7"

    moves_y: bool = False

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """i_c late alone; of a digital controller also y early, and that alone where the amplifier is ideal."""
        if seen.rig.amplifier.time_constant == 0.0:
            return (self,)
        return [SamplingSkew(moves_y) for moves_y in (False, True)[: 1 + seen.rig.controller.is_digital]]

    def why_not(self, rig: Rig) -> str:
        """Where i_c does not move between samples, and the controller's output has no instants either."""
        if rig.amplifier.time_constant > 0.0 or self._reads_y_early(rig):
            return ""
        return "an ideal amplifier holds i_c over the sample, and an analog controller has no instants"

    def _reads_y_early(self, rig: Rig) -> bool:
        return self.moves_y or (rig.controller.is_digital and rig.amplifier.time_constant == 0.0)

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """By how much i_c is read late, and y early [s]."""
        sample = 1.0 / rig.sample_rate
        reach, found = REACH * sample, []
        if rig.amplifier.time_constant > 0.0:
            probe, meaning = (
                min(0.02 * sample, 0.25 * rig.amplifier.time_constant),
                "by how much later than y i_c is read, d; negative where the record of i_c lags",
            )
            found.append(EffectParameter("current_late", "s", probe, lower=-reach, upper=reach, meaning=meaning))
        if self._reads_y_early(rig):
            meaning = "by how much y is read early, e"
            found.append(EffectParameter("displacement_early", "s", 0.02 * sample, upper=reach, meaning=meaning))
        return found

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """A late i_c, and an early y, which is a lag round the loop too."""
        late, early = values.get("current_late", 0.0), values.get("displacement_early", 0.0)
        lags = {LAG_OF_READING: early - late}
        return lags | {LAG_ROUND_LOOP: early} if self._reads_y_early(rig) else lags | {LAG_OF_CURRENT: late}

    def attach(self, plant: Plant) -> None:
        """Exact: from the instants at which y is read, commands come late by e, and i_c is read by d + e after them."""
        late, early = self.slot("current_late"), self.slot("displacement_early")
        reads_early = self._reads_y_early(plant.rig)
        if reads_early:
            plant.delay_commands(early)
        for axis in plant.axes:
            if plant.rig.amplifier.time_constant > 0.0:
                plant.record_late(f"i_c.{axis}", late, -1.0)
            if reads_early:
                plant.record_late(f"i_c.{axis}", early, -1.0)


@dataclass(frozen=True)
class ChannelDelay(Effect):
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
    within_command = True

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


EFFECTS = (SamplingSkew(), ChannelDelay())
