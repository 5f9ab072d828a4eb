"""The catalogue of physical effects that a model may lack."""

from collections.abc import Mapping
from typing import Any

from ambid.effects.actuator import AxisCrossCoupling, EddyCurrents
from ambid.effects.amplifier import AmplifierBandwidth, AmplifierVoltageLimit, BackEmf, LoopDelay
from ambid.effects.disturbance import PeriodicDisturbance, Unbalance
from ambid.effects.magnet import FluxSaturation, ForceNonlinearity, MagneticHysteresis
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
from ambid.loop.effect import Effect, EffectParameter, Seen

__all__ = ["CATALOGUE", "Effect", "EffectParameter", "Seen", "find"]

CATALOGUE: tuple[Effect, ...] = (
    RotorBendingMode(),
    BendingModeShift(),
    RotorInertiaError(),
    GyroscopicCoupling(),
    Unbalance(),
    SealForces(),
    CouplingStiffness(),
    FoundationResonance(),
    ForceNonlinearity(),
    FluxSaturation(),
    EddyCurrents(),
    MagneticHysteresis(),
    AxisCrossCoupling(),
    AmplifierBandwidth(),
    AmplifierVoltageLimit(),
    LoopDelay(),
    SensorLag(),
    SensorGainError(),
    SensorMisalignment(),
    SensorPositionError(),
    SamplingSkew(),
    BackEmf(),
    PeriodicDisturbance(),
)


def find(name: str, settings: Mapping[str, Any] | None = None) -> Effect:
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
