"""The catalogue of physical effects that a model may lack."""

from collections.abc import Mapping

from ambid.effects.actuator import AxisCrossCoupling, EddyCurrents
from ambid.effects.amplifier import AmplifierBandwidth, BackEmf, LoopDelay
from ambid.effects.base import Effect, EffectParameter
from ambid.effects.rotor import BendingModeShift, GyroscopicCoupling, RotorBendingMode, RotorInertiaError
from ambid.effects.sensor import (
    SamplingSkew,
    SensorGainError,
    SensorLag,
    SensorMisalignment,
    SensorPositionError,
)
from ambid.effects.support import CouplingStiffness, FoundationResonance, SealForces
from ambid.errors import ModelError

__all__ = ["CATALOGUE", "Effect", "EffectParameter", "find"]

CATALOGUE: tuple[Effect, ...] = (
    RotorBendingMode(),
    BendingModeShift(),
    RotorInertiaError(),
    GyroscopicCoupling(),
    SealForces(),
    CouplingStiffness(),
    FoundationResonance(),
    EddyCurrents(),
    AxisCrossCoupling(),
    AmplifierBandwidth(),
    LoopDelay(),
    SensorLag(),
    SensorGainError(),
    SensorMisalignment(),
    SensorPositionError(),
    SamplingSkew(),
    BackEmf(),
)


def find(name: str, settings: Mapping[str, float] | None = None) -> Effect:
    """Effect of the catalogue by name; with settings, the variant of it that they make.

    Raises
    ------
    ModelError
        If there is none.
    """
    for effect in CATALOGUE:
        if effect.name == name:
            return type(effect)(**settings) if settings else effect
    raise ModelError(f"{name}: no such effect; the catalogue has {', '.join(effect.name for effect in CATALOGUE)}")
