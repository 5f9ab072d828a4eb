"""Effects of the coil between the voltage of the amplifier and its current."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ambid.effects.amplifier import FAR, IDEAL
from ambid.effects.traits import LAG_OF_CURRENT, LAG_ROUND_LOOP
from ambid.loop.effect import Effect, EffectParameter, Trait
from ambid.loop.plant import SENSED, Plant
from ambid.rig import Rig

CURRENT_DRIVEN = (
    "the current is commanded, and the rig file holds no inductance: amplifier_bandwidth is the lag of the amplifier "
    "(amplifier.resistance, with the time constant L/R, makes it a coil whose voltage is commanded)"
)
WITHOUT_INDUCTANCE = "the coil has no inductance in the rig file (amplifier.time_constant = L/R = 0)"


@dataclass(frozen=True)
class BackEmf(Effect):
    """Motion induces voltage."""

    name = "back_emf"
    physics = "motion of the rotor induces voltage in the coil: the current responds to velocity"
    equation = "tau_a i_a' = i_set - i_a - b v; of a voltage-driven coil L i' = u - R i - b v"
    signature = "i_c in phase with velocity, in a band where the amplifier does not hold the current"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, section 4.3"

    def why_not(self, rig: Rig) -> str:
        """An ideal amplifier of current."""
        return "" if rig.amplifier.resistance is not None or rig.amplifier.time_constant > 0.0 else IDEAL

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Current per velocity [A s/m]; of a voltage-driven coil [V s/m], where it is K_i if nothing is lost."""
        if self.why_not(rig):
            return []
        if rig.amplifier.resistance is not None:
            probe, meaning = 0.1 * rig.bearings[0].force_current[0], "induced voltage per velocity b"
            return [EffectParameter("voltage_per_velocity", "V s/m", probe, meaning=meaning)]
        scale = rig.bearings[0].bias_current / rig.bearings[0].air_gap * rig.amplifier.time_constant
        meaning = "current that velocity drives against the command, b"
        return [EffectParameter("current_per_velocity", "A s/m", 0.02 * scale, meaning=meaning)]

    def attach(self, plant: Plant) -> None:
        """What the amplifier is set to falls by b v; of a voltage-driven coil, its voltage."""
        slot, port = self.slot("current_per_velocity"), "i_set"
        if plant.rig.amplifier.resistance is not None:
            slot, port = self.slot("voltage_per_velocity"), "i_ref"
        for axis in plant.axes:
            induced = plant.port(slot, plant[f"v.{axis}"])
            plant.inject(f"{port}.{axis}", -induced)
            if port == "i_ref":
                plant.inject(f"{SENSED}u.{axis}", induced)


@dataclass(frozen=True)
class InductanceError(Effect):
    """A voltage-driven coil whose inductance is another one, and changes with the gap."""

    name = "inductance_error"
    physics = "the inductance of a voltage-driven coil differs from the rig file's, and grows as the gap closes"
    equation = "(1 + d) L_0 phi' = u - R i, i = (1 - g s/gap) phi, L_0 of the rig file: 1/L in proportion to reluctance"
    signature = "i_c lags its voltage otherwise than L/R says; where motion is large, the more the nearer the rotor is"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, sections 3.1 (magnetic circuit) and 4.3 (coil)"
    contains = ("amplifier_bandwidth",)

    def why_not(self, rig: Rig) -> str:
        """A coil whose current is commanded, or one without inductance."""
        if rig.amplifier.resistance is None:
            return CURRENT_DRIVEN
        return "" if rig.amplifier.time_constant > 0.0 else WITHOUT_INDUCTANCE

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Relative error of the inductance at rest, and the part of the reluctance that is the gap's."""
        if self.why_not(rig):
            return []
        of_gap = "part g of the reluctance that lies in the gap: the rest, such as iron, does not change with it"
        return [
            EffectParameter("error", "1", 0.05, -0.9, 1e3, "relative error d of the inductance at rest"),
            EffectParameter("gap_part", "1", 0.1, upper=1.0, meaning=of_gap),
        ]

    def far_starts(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """From a lag that is far too short a score sees nothing of a lag of many samples."""
        return [] if self.why_not(rig) else [{"error": times - 1.0, "gap_part": 0.1} for times in FAR]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """By how much the lag of the coil is longer than that of the rig file."""
        return dict.fromkeys((LAG_OF_CURRENT, LAG_ROUND_LOOP), rig.amplifier.time_constant * values["error"])

    def attach(self, plant: Plant) -> None:
        """The flux linkage over the nominal inductance is the state; the current follows from it and the gap."""
        tau = plant.rig.amplifier.time_constant
        gaps = [bearing.air_gap for bearing in plant.rig.bearings for _ in bearing.axes]
        for axis, gap in zip(plant.axes, gaps, strict=True):
            linkage = plant.state(f"linkage.{axis}")
            bent = plant.block("polynomial", [linkage, plant[f"s.{axis}"]], {}, {"c0": 1.0 / gap}, exponents=[[1, 1]])
            current = linkage - plant.port(self.slot("gap_part"), bent)
            (rate,) = plant.of_amplifier(axis, "linkage", [(plant[f"i_set.{axis}"] - current) / tau])
            (name,) = plant.amplifier_rates[axis]
            plant.inject(name, -plant.port(self.slot("error"), rate))
            plant.set_rate(f"linkage.{axis}", rate + plant.cut(axis))
            for signal, true in (("i_a", current), ("i_a_free", rate)):
                plant.inject(f"{signal}.{axis}", true - plant.raw(f"{signal}.{axis}"))


EFFECTS = (
    BackEmf(),
    InductanceError(),
)
