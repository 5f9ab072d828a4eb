"""Slips beside the physics: gains in the rig file that are not the machine's, wrong scales and instants of the record.

Named, they say that the rig file or the record is wrong, and not what the model knows of the machine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambid.effects.sensor import REACH
from ambid.effects.traits import GAIN_OF_ANSWER, LAG_OF_READING
from ambid.findings import Finding, Kind, Where
from ambid.loop.effect import Effect, EffectParameter, Seen, Trait
from ambid.loop.plant import Plant
from ambid.rig import PidController, Rig

LEAST, MOST = -0.9, 9.0
"""Relative errors that are sought: a factor of ten to either side."""
MINOR = 0.05
"""Gains whose error is a smaller part of the largest one are not reported."""
RIG_FILE = "the rig file is wrong, and not the physics of the model"
GAIN = Kind(
    "controller_gain_wrong",
    "warning",
    f"the rig file has {{in_file:.6g}}, the data ask for {{by_data:.6g}}: {RIG_FILE}",
    "correct the gain in the rig file",
)
CONTROLLER = Kind(
    "controller_wrong",
    "warning",
    f"the data ask for {{factor:.4g}} times the controller of the rig file: {RIG_FILE}",
    "correct the controller in the rig file",
)
CONTROLLER_MAY_BE = Kind(
    "controller_may_be_wrong",
    "warning",
    f"{{effect}}, which explains the data as well, would mean that {RIG_FILE}",
)
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


@dataclass(frozen=True)
class ControllerGainError(Effect):
    """Gains of the controller that differ from those of the rig file, on all axes alike."""

    name = "controller_gain_error"
    physics = "a slip: the controller runs with other gains than the rig file says"
    equation = "K = (1 + p) P + (1 + i) I/s + (1 + d) D s/(T s + 1) of a PID; K = (1 + g) K_file of any other"
    signature = "i_c follows from i_e and y with other factors than those of the rig file, the same at every amplitude"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"
    within_command = True

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative error of each gain that a PID has, or of the whole of any other controller."""
        return [
            EffectParameter(gain, "1", 0.05, LEAST, MOST, f"relative error of {_meaning(gain)} in the rig file")
            for gain in rig.controller.gains
        ]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """A stiffer loop answers less, by another gain at every frequency."""
        return {GAIN_OF_ANSWER: float("nan")}

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """The gains that the data ask for, beside those of the rig file."""
        if values is None:
            return [CONTROLLER_MAY_BE(Where(key="controller"), effect=self.name)]
        if not isinstance(rig.controller, PidController):
            return [CONTROLLER(Where(key="controller"), factor=1.0 + error) for error in values.values()]
        least = MINOR * max(abs(error) for error in values.values())
        found = []
        for gain, error in values.items():
            if abs(error) >= least:
                in_file = np.atleast_1d(getattr(rig.controller, gain))
                own = {"in_file": in_file.tolist(), "by_data": ((1.0 + error) * in_file).tolist()}
                found.append(GAIN(Where(key=f"controller.{gain}"), **own))
        return found

    def attach(self, plant: Plant) -> None:
        """The same on every axis; exact also where the controller samples, holds and delays."""
        for p in self.parameters(plant.reference):
            plant.scale_controller(self.slot(p.name), p.name)


@dataclass(frozen=True)
class ExcitationGainError(Effect):
    """A scale of the excitation that differs from the record's, on all axes alike."""

    name = "excitation_gain_error"
    physics = "a slip: the excitation that acts is larger or smaller than the record says"
    equation = "i_ref = -K y + (1 + e) i_e"
    signature = "y and i_c too large or too small by one factor at all frequencies, in a loop whose poles are right"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"
    within_command = True

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


def _meaning(gain: str) -> str:
    return "the gain of the controller" if gain == "gain" else f"the {gain} gain"


EFFECTS = (ControllerGainError(), ExcitationGainError(), ChannelDelay())
