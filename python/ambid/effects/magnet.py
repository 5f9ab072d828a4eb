"""Nonlinear effects of the magnets: force law and iron."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ambid.loop.effect import Effect, EffectParameter, Seen
from ambid.loop.plant import Plant
from ambid.rig import Rig


class ForceNonlinearity(Effect):
    """The square law of the magnets in place of its linearisation."""

    name = "force_nonlinearity"
    physics = "the unsaturated force law k((i0+i)^2/(s0-s)^2 - (i0-i)^2/(s0+s)^2) in place of its linearisation"
    signature = "odd; grows with the cube of the amplitude, where current and displacement are large together"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, section 4.1"

    def __init__(self, held: Sequence[float] = ()) -> None:
        self.held = tuple(held)

    def settings(self) -> dict[str, Any]:
        """Current of each axis that holds the weight [A]; nothing where it is not known."""
        return {"held": list(self.held)} if self.held else {}

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """About the currents that hold the weight."""
        return [ForceNonlinearity(seen.held)]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Bias current of the rig file over the effective one: 1 for the law as it stands, 0 for the linear one."""
        return [EffectParameter("bias_ratio", "1", 1.0, upper=10.0)]

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """The nonlinear part grows with the square of the ratio."""
        return {"bias_ratio": float(np.sqrt(np.clip(amplitudes[0], 1e-4, 9.0)))}

    def attach(self, plant: Plant) -> None:
        """What the law adds to ``K_i i + K_s s``, which stay the slopes at rest; s0 = i0 K_i / K_s."""
        _force_law(plant, "unsaturated", {"nu": self.slot("bias_ratio")}, self.held)


class FluxSaturation(Effect):
    """Iron whose flux density levels off."""

    name = "flux_saturation"
    physics = "the iron saturates: force per current falls at high flux"
    signature = "odd; K_i seems to fall with amplitude and with load"
    source = "Froehlich (1881) and its generalisation B = u/(1 + (sigma u)^n)^(1/n)"
    contains = ("force_nonlinearity",)

    def __init__(self, held: Sequence[float] = ()) -> None:
        self.held = tuple(held)

    def settings(self) -> dict[str, Any]:
        """Current of each axis that holds the weight [A]; nothing where it is not known."""
        return {"held": list(self.held)} if self.held else {}

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """About the currents that hold the weight."""
        return [FluxSaturation(seen.held)]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Linear flux density at bias over that of saturation, sharpness of the knee, bias ratio of the square law."""
        return [
            EffectParameter("level", "1", 0.5, upper=3.0),
            EffectParameter("sharpness", "1", 2.0, lower=0.8, upper=12.0),
            EffectParameter("bias_ratio", "1", 1.0, lower=0.2, upper=5.0),
        ]

    def probes(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Three knees."""
        knees = ((0.5, 2.0), (0.8, 2.0), (0.7, 4.0))
        return [{"level": level, "sharpness": sharp, "bias_ratio": 1.0} for level, sharp in knees]

    def amplitudes(self, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        """More or less of each: the knee may lie between or beyond them."""
        return np.full(3, -3.0), np.full(3, 3.0)

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """A middling knee."""
        return {"level": 0.7, "sharpness": 2.5, "bias_ratio": 1.0}

    def attach(self, plant: Plant) -> None:
        """The square law with the flux of saturating iron; K_i and K_s stay the slopes at rest."""
        slots = {"sigma": "level", "n": "sharpness", "nu": "bias_ratio"}
        _force_law(plant, "power", {key: self.slot(name) for key, name in slots.items()}, self.held)


class MagneticHysteresis(Effect):
    """A rate-independent loop between current and flux."""

    name = "magnetic_hysteresis"
    physics = "rate-independent loop between current and flux: part of the current follows a hysteresis"
    signature = "the flux lags by the same angle at every frequency, and less at larger amplitude"
    source = "Wen, ASCE J. Eng. Mech. 102 (1976) 249, exponent 1"

    def __init__(self, width: float = 0.3) -> None:
        self.width = width

    def settings(self) -> dict[str, float]:
        """Width that the probe has [A]."""
        return {"width": self.width}

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Loops narrow and wide against the current that flows."""
        return [MagneticHysteresis(float(seen.peaks["i_f"] * share)) for share in (0.03, 0.1, 0.3, 1.0)]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Part of the current that follows the hysteresis, and one over its width [1/A]."""
        return [
            EffectParameter("share", "1", 0.01, lower=-0.9, upper=0.9),
            EffectParameter("inverse_width", "1/A", 1.0 / self.width, lower=1e-3, upper=1e4),
        ]

    def probes(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """A small loop of the width of this variant."""
        return [{p.name: p.probe for p in self.parameters(rig)}]

    def amplitudes(self, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        """Flux may only lag."""
        return np.zeros(1), np.full(1, 90.0)

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """The width of the probe, and as much of it as the residual calls for."""
        share = 0.01 * float(np.clip(amplitudes[0], 0.01, 60.0))
        return {"share": share, "inverse_width": 1.0 / self.width}

    def attach(self, plant: Plant) -> None:
        """``h' = i' - (|i'| h + i' |h|)/(2 width)``; the flux follows ``i - share h``."""
        slot = self.slot("inverse_width")
        smoothing = {"A": 1.0, "rate_smoothing": 100.0, "state_smoothing": 0.05 * self.width}
        for axis in plant.axes:
            name = f"hysteresis.{axis}"
            h = plant.state(name)
            rate = plant.block("bouc_wen", [plant[f"i_f_rate.{axis}"], h], {"beta": slot, "gamma": slot}, smoothing)
            plant.set_rate(name, rate)
            plant.inject(f"i_f.{axis}", -plant.port(self.slot("share"), h))


def _force_law(plant: Plant, curve: str, slots: Mapping[str, str], held: Sequence[float]) -> None:
    """Add to the force of every axis what a force law has beyond ``K_i i + K_s s``.

    At another bias than that of the reference the flux at rest is in proportion to it, and the current that holds the
    weight goes with one over K_i.
    """
    here, there = _of_axes(plant.rig), _of_axes(plant.reference)
    loads = held or [0.0] * len(here)
    for axis, (bias, gain), (stated, gain_there), load in zip(plant.axes, here, there, loads, strict=True):
        own = {"K_i": f"K_i.{axis}", "K_s": f"K_s.{axis}", **slots}
        signals = [plant[f"i_f.{axis}"], plant[f"s.{axis}"]]
        constants = {"bias": bias, "held": load * gain_there / gain, "level": bias / stated}
        plant.inject(f"f.{axis}", plant.block("force_law", signals, own, constants, curve=curve))


def _of_axes(rig: Rig) -> list[tuple[float, float]]:
    """Bias current [A] and nominal K_i [N/A] of every axis."""
    return [(bearing.bias_current, k_i) for bearing in rig.bearings for k_i in bearing.force_current]
