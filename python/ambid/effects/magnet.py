"""Effects of the magnets, from coil current to force: force law, iron, and what one axis does to the other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Self

import numpy as np
from scipy.optimize import nnls

from ambid.effects.hysteresis import drawn_along, gradual
from ambid.effects.places import of_two_axes
from ambid.effects.traits import CURVATURE, LAG_OF_READING, LAG_ROUND_LOOP
from ambid.loop.assembly import Signal, combine
from ambid.loop.effect import Effect, EffectParameter, OneProbe, Seen, Trait
from ambid.loop.plant import SENSED, Plant
from ambid.rig import Rig

HOLDING = 0.8
"""Part of the bias from which a mean current says that it holds a weight alone: of a pair of magnets that would carry
it so, the lower one were all but off."""
ABOUT_REST = 0.02
"""Part of the bias within which a mean current says nothing of a weight: it may be stated about that which holds it."""

APART = 0.02
"""Of the bias, of two currents whose forces differ by their slope; any would do, unless a magnet carries none."""
BIAS_RATIO = "nu: bias current of the rig file over the effective one"


class _Law(Effect):
    """What a law of attracting magnets has beyond its slopes at rest."""

    def why_not(self, rig: Rig) -> str:
        """Magnets that centre: the law is that of attracting ones."""
        centres = any(k_s < 0.0 for bearing in rig.bearings for k_s in bearing.force_displacement)
        return "K_s is negative, and the law is that of attracting magnets" if centres else ""

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """Another curvature, in whichever direction."""
        return {CURVATURE: float("nan")}


@dataclass(frozen=True)
class _OddLaw(_Law):
    """A law of the force of opposed magnets that are alike, or of a single one.

    Attributes
    ----------
    held : tuple of float
        Current of each axis that holds the weight [A]; empty where it is not known.
    single : bool
        Whether one magnet holds the weight, with the bias current, and none acts against it.
    """

    held: tuple[float, ...] = ()
    single: bool = False

    def variants(self, seen: Seen) -> Sequence[Self]:
        """About the currents that hold the weight; of one magnet where it may be that, see `_magnets`."""
        return [replace(self, held=held, single=single) for held, single in _magnets(seen)]


@dataclass(frozen=True)
class ForceNonlinearity(_OddLaw):
    """The square law of the magnets in place of its linearisation."""

    name = "force_nonlinearity"
    physics = "the unsaturated force law k((i0+i)^2/(s0-s)^2 - (i0-i)^2/(s0+s)^2) in place of its linearisation"
    equation = (
        "F = K_i i0 (x+^2 - x-^2)/4, x+- = (1 +- i/i0)/(1 -+ s/s0), i0 = bias/nu, s0 = i0 K_i/K_s; "
        "of a single magnet F = K_i i0 (x+^2 - 1)/2"
    )
    signature = "odd; grows with the cube of the amplitude, where current and displacement are large together"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, section 4.1"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Bias current of the rig file over the effective one: 1 for the law as it stands, 0 for the linear one."""
        return [EffectParameter("bias_ratio", "1", 1.0, upper=10.0, meaning=BIAS_RATIO)]

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """The nonlinear part grows with the square of the ratio."""
        return {"bias_ratio": float(np.sqrt(np.clip(amplitudes[0], 1e-4, 9.0)))}

    def attach(self, plant: Plant) -> None:
        """What the law adds to ``K_i i + K_s s``, which stay the slopes at rest."""
        _force_law(plant, "unsaturated", {"nu": self.slot("bias_ratio")}, self.held, self.single)


@dataclass(frozen=True)
class FluxSaturation(_OddLaw):
    """Iron whose flux density levels off."""

    name = "flux_saturation"
    physics = "the iron saturates: force per current falls at high flux"
    equation = (
        "F = K_i i0 (B(x+)^2 - B(x-)^2)/(4 B(1) B'(1)), B(x) = x/(1 + (sigma x)^n)^(1/n), x+- = (1 +- i/i0)/(1 -+ s/s0)"
        "; of a single magnet F = K_i i0 (B(x+)^2 - B(1)^2)/(2 B(1) B'(1))"
    )
    signature = "odd; K_i seems to fall with amplitude and with load"
    source = "Froehlich (1881) and its generalisation B = u/(1 + (sigma u)^n)^(1/n)"
    contains = ("force_nonlinearity",)
    formula_error = 0.004  # iron curves differ: of others than its own it leaves 0.03 to 0.4 %

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Linear flux density at bias over that of saturation, sharpness of the knee, bias ratio of the square law."""
        return [
            EffectParameter(
                "level", "1", 0.5, upper=3.0, meaning="sigma: linear flux density at bias over that of saturation"
            ),
            EffectParameter("sharpness", "1", 2.0, lower=0.8, upper=12.0, meaning="n: sharpness of the knee"),
            EffectParameter("bias_ratio", "1", 1.0, lower=0.2, upper=5.0, meaning=BIAS_RATIO),
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
        _force_law(plant, "power", {key: self.slot(name) for key, name in slots.items()}, self.held, self.single)


def _magnets(seen: Seen) -> list[tuple[tuple[float, ...], bool]]:
    """The current that holds the weight on each axis, and whether one magnet does so alone: what may be tried.

    One magnet holds a plain mass where the mean of its recorded current is the bias, see `HOLDING`. Where that mean is
    nothing, beside what a pair needs, the current may be stated about that at rest: then either may be.
    """
    (bias, *more) = (bias for bias, _, _ in _of_axes(seen.rig))
    is_plain = seen.rig.rotor.kind == "mass" and not more
    if is_plain and seen.held and seen.held[0] >= HOLDING * bias:
        return [((), True)]
    pair = (tuple(seen.held), False)
    is_about_rest = is_plain and bool(seen.held) and abs(seen.held[0]) < ABOUT_REST * bias
    return [pair, ((), True)] if is_about_rest else [pair]


def _force_law(plant: Plant, curve: str, slots: Mapping[str, str], held: Sequence[float], single: bool) -> None:
    """Add to the force of every axis what a force law has beyond ``K_i i + K_s s``.

    At another bias and gap than those of the reference the flux at rest is in proportion to bias over gap, and the
    current that holds the weight goes with one over K_i. The force goes with the square of the flux density that Hall
    sensors read.
    """
    here, there = _of_axes(plant.rig), _of_axes(plant.reference)
    loads = held or [0.0] * len(here)
    for axis, (bias, gap, gain), (stated, gap_there, gain_there), load in zip(
        plant.axes, here, there, loads, strict=True
    ):
        own = {"K_i": f"K_i.{axis}", "K_s": f"K_s.{axis}", **slots}
        signals = [plant[f"i_f.{axis}"], plant[f"s.{axis}"]]
        constants = {"bias": bias, "held": load * gain_there / gain, "level": bias / stated * gap_there / gap}
        plant.inject(f"f.{axis}", plant.block("force_law", signals, own, constants, curve=curve, single=single))
        if f"b.{axis}" in plant.measured:
            root = plant.block("force_law", signals, own, constants, curve=f"root_{curve}", single=single)
            plant.inject(f"{SENSED}b.{axis}", root / plant.rig.force_per_flux[axis])


def _of_axes(rig: Rig) -> list[tuple[float, float, float]]:
    """Bias current [A], air gap [m] and nominal K_i [N/A] of every axis."""
    return [(bearing.bias_current, bearing.air_gap, k_i) for bearing in rig.bearings for k_i in bearing.force_current]


@dataclass(frozen=True)
class BiasAsymmetry(_Law):
    """Opposed magnets that are not alike: the even part of the square law, which a pair that is alike has none of."""

    name = "bias_asymmetry"
    physics = (
        "opposed magnets have another bias current, or another strength, than each other: the force has an even part"
    )
    equation = (
        "F + K_i i0 (a g1/2 + b g2/4), gn = (1 + u)^n/(1 - x)^2 + (1 - u)^n/(1 + x)^2 - 2, u = i/i0, x = s/s0, "
        "s0 = i0 K_i/K_s: what is even in K_i i0/4 ((1 + b) (1 + a + u)^2/(1 - x)^2 - (1 - b) (1 - a - u)^2/(1 + x)^2)"
    )
    signature = "even: twice the frequency of what drives it, and a mean that grows with the square of the amplitude"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, section 4.1"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative difference of the biases, and of the strengths, of opposed magnets."""
        half = "of opposed magnets, half their difference over their mean"
        return [
            EffectParameter("bias", "1", 0.01, -0.9, 0.9, f"a: bias currents {half}"),
            EffectParameter("strength", "1", 0.01, -0.9, 0.9, f"b: strengths {half}"),
        ]

    def attach(self, plant: Plant) -> None:
        """On every axis. The force being square in the current, g1 is a difference of two forces, and g2 the sum of
        what either magnet does alone."""
        for axis, (bias, *_) in zip(plant.axes, _of_axes(plant.rig), strict=True):
            law = partial(_square_law, plant, axis, bias)
            by_bias = (law(held=APART * bias) - law(held=-APART * bias)) / (2.0 * APART)
            by_strength = 0.5 * (law(single=True) + law(sign=-1.0, single=True))
            for name, force in (("bias", by_bias), ("strength", by_strength)):
                plant.inject(f"f.{axis}", plant.port(self.slot(name), force))


def _square_law(
    plant: Plant, axis: str, bias: float, *, sign: float = 1.0, held: float = 0.0, single: bool = False
) -> Signal:
    """What the square law has beyond ``K_i i + K_s s``, of a pair about a held current or of a single magnet."""
    signals = [sign * plant[f"i_f.{axis}"], sign * plant[f"s.{axis}"]]
    slots = {"K_i": f"K_i.{axis}", "K_s": f"K_s.{axis}"}
    constants = {"nu": 1.0, "bias": bias, "held": held}
    return plant.block("force_law", signals, slots, constants, curve="unsaturated", single=single)


@dataclass(frozen=True)
class EddyCurrents(Effect):
    """Half-order lag of the flux."""

    name = "eddy_currents"
    physics = "eddy currents make the flux lag the current slower than first order: 1/(1 + sqrt(tau s))"
    equation = "flux = i/(1 + sqrt(tau s)), s of Laplace"
    signature = "force too small and late over decades of frequency, half as steep as a lag"
    source = "Zhu, Knospe, Maslen, IEEE/ASME Trans. Mechatronics 10 (2005) 59"
    plural = True

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Root of the time constant tau of the half-order lag [s^0.5]; the effect is in proportion to it."""
        meaning = "sqrt(tau), square root of the time constant of the half-order lag"
        return [EffectParameter("root_time_constant", "s^0.5", 1e-4, upper=0.1, meaning=meaning)]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """A lag that is longer at lower frequency."""
        return dict.fromkeys((LAG_OF_READING, LAG_ROUND_LOOP), float("nan"))

    def attach(self, plant: Plant) -> None:
        """``flux = i - sqrt(tau) sqrt(s) flux``, with sqrt(s) as a sum of ``c s/(s + p)`` whatever tau is."""
        poles, weights = half_derivative()
        for k, axis in enumerate(plant.axes):
            # poles of different axes must not coincide: the loop would have no well-conditioned modes
            apart = 1.0 + 0.03 * k
            flux = plant[f"i_f.{axis}"]
            parts = []
            for j, pole in enumerate(poles):
                name = f"eddy.{axis}.{j}"
                state = plant.state(name)
                plant.set_rate(name, pole * apart * (flux - state))
                parts.append(flux - state)
            lost = combine(weights * np.sqrt(apart), parts)
            plant.inject(f"i_f.{axis}", -plant.port(self.slot("root_time_constant"), lost))


@cache
def half_derivative() -> tuple[np.ndarray, np.ndarray]:
    """Poles p [1/s] and weights c of ``sqrt(s) ~ sum c s/(s + p)``.

    Non-negative least squares of the relative error over 3 .. 1e5 rad/s.
    """
    poles = np.geomspace(0.3, 2e6, 16)
    w = np.geomspace(3.0, 1e5, 300)
    target = np.sqrt(1j * w)
    parts = 1j * w[:, None] / (1j * w[:, None] + poles) / target[:, None]
    weights, _ = nnls(np.vstack([parts.real, parts.imag]), np.concatenate([np.ones(len(w)), np.zeros(len(w))]))
    return poles, weights


@dataclass(frozen=True)
class MagneticHysteresis(OneProbe):
    """A rate-independent loop between current and flux.

    Attributes
    ----------
    width : float
        That the probe has [A].
    fastest : float
        Rate of the current that flows, the largest [A/s].
    """

    name = "magnetic_hysteresis"
    physics = "rate-independent loop between current and flux: part of the current follows a hysteresis"
    equation = "flux = i - c h width/2, h' = 2 (i' - |i'| |h|^n sign h)/width"
    signature = "the flux lags by the same angle at every frequency, and less at larger amplitude"
    source = "Wen, ASCE J. Eng. Mech. 102 (1976) 249"
    # laws differ: of plays in parallel it leaves 0.02 to 1.2 %, and 2 to 7 % where loops are small beside their width
    usual_error, formula_error = 5e-3, 0.07
    size, most, refitted = "share", 90.0, (0.01, 60.0)

    width: float = 0.3
    fastest: float = 3e3

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Loops narrow and wide against the current that flows."""
        peak, fastest = seen.peaks["i_f"], seen.peaks["i_f_rate"]
        return [MagneticHysteresis(float(share * peak), float(fastest)) for share in (0.03, 0.1, 0.3, 1.0)]

    def why_not(self, rig: Rig) -> str:
        """A current that jumps."""
        has_rate = rig.actuator.has_lag or rig.amplifier.time_constant > 0.0
        return "" if has_rate else "neither amplifier nor actuator has a lag: the current jumps, and has no rate"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Part of the current that follows the hysteresis, one over its width [1/A], and how gradually it turns."""
        return [
            EffectParameter("share", "1", 0.01, upper=0.9, meaning="part c of the current that follows the hysteresis"),
            EffectParameter(
                "inverse_width",
                "1/A",
                1.0 / self.width,
                lower=1e-3,
                upper=1e4,
                meaning="one over the width of the loop, across which h goes from -1 to 1",
            ),
            gradual(),
        ]

    def attach(self, plant: Plant) -> None:
        """A Bouc-Wen state for each axis."""
        for axis in plant.axes:
            ((_, drawn),) = drawn_along(plant, self, {axis: plant[f"i_f_rate.{axis}"]}, self.fastest)
            plant.inject(f"i_f.{axis}", -plant.port(self.slot("share"), drawn))


@dataclass(frozen=True)
class AxisCrossCoupling(Effect):
    """Current along one axis makes force along the other axis of the same bearing."""

    name = "axis_cross_coupling"
    physics = "current along eta also makes force along zeta of the same bearing, and back"
    equation = "F_zeta of i_zeta + c i_eta, F_eta of i_eta + c i_zeta"
    signature = "zeta answers eta and eta answers zeta with the same sign, at one bearing"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 3"
    across_planes = True

    def why_not(self, rig: Rig) -> str:
        """Bearings of one axis."""
        return "" if of_two_axes(rig) else "no bearing has two axes"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Part of the force that appears on the other axis, of each bearing."""
        return [
            EffectParameter(
                f"share_{b.name}",
                "1",
                0.005,
                lower=-0.5,
                upper=0.5,
                meaning=f"part c of the current that acts along the other axis too, bearing {b.name}",
            )
            for b in of_two_axes(rig)
        ]

    def attach(self, plant: Plant) -> None:
        """Of the current that makes force."""
        for bearing in of_two_axes(plant.rig):
            zeta, eta = bearing.axis_names
            slot = self.slot(f"share_{bearing.name}")
            for to, source in ((zeta, eta), (eta, zeta)):
                plant.inject(f"i_f.{to}", plant.port(slot, plant.raw(f"i_f.{source}")))


EFFECTS = (
    ForceNonlinearity(),
    FluxSaturation(),
    BiasAsymmetry(),
    EddyCurrents(),
    MagneticHysteresis(),
    AxisCrossCoupling(),
)
