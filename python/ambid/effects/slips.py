"""Errors of the rig file that no tolerance of the machine explains: gains of its controller.

Named, they say that the rig file is wrong, and not what the model knows of the machine.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambid.effects.traits import GAIN_OF_ANSWER
from ambid.effects.updates import with_controller_gain
from ambid.findings import Finding, Kind, Where
from ambid.loop.effect import Effect, EffectParameter, Trait
from ambid.loop.plant import Plant
from ambid.rig import PidController, Rig

LEAST, MOST = -0.9, 9.0
"""Relative errors of what is positive, as far as they are sought: a factor of ten to either side."""
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
    "controller_may_be_wrong", "warning", f"{{effect}}, which explains the data as well, would mean that {RIG_FILE}"
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

    def corrected(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """The gains that the data ask for."""
        for gain, error in values.items():
            rig = with_controller_gain(rig, gain, error)
        return rig

    def attach(self, plant: Plant) -> None:
        """The same on every axis; exact also where the controller samples, holds and delays."""
        for p in self.parameters(plant.reference):
            plant.scale_controller(self.slot(p.name), p.name)


def _meaning(gain: str) -> str:
    return "the gain of the controller" if gain == "gain" else f"the {gain} gain"


EFFECTS = (ControllerGainError(),)
