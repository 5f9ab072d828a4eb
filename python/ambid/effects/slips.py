"""Slips beside the physics: gains in the rig file that are not the machine's, and a wrong scale of the excitation.

Named, they say that the rig file or the record is wrong, and not what the model knows of the machine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ambid.effects.traits import GAIN_OF_ANSWER
from ambid.loop.effect import Effect, EffectParameter, Trait
from ambid.loop.plant import Plant
from ambid.rig import Rig

LEAST, MOST = -0.9, 9.0
"""Relative errors that are sought: a factor of ten to either side."""


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

    def attach(self, plant: Plant) -> None:
        """The same on every axis."""
        plant.scale_excitation(self.slot("scale"))


def _meaning(gain: str) -> str:
    return "the gain of the controller" if gain == "gain" else f"the {gain} gain"


EFFECTS = (ControllerGainError(), ExcitationGainError())
