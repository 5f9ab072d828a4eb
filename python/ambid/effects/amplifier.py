"""Effects of amplifier and controller, from measured displacement to coil current."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from ambid.effects.traits import LAG_OF_CURRENT, LAG_ROUND_LOOP
from ambid.loop.assembly import Signal
from ambid.loop.effect import Effect, EffectParameter, OneProbe, Seen, Trait
from ambid.loop.plant import Plant
from ambid.rig import Rig

IDEAL = "the amplifier is ideal: its current is what it is asked for (amplifier.time_constant = 0)"

SECOND_ORDER, OTHER_LAG, FURTHER_LAG = "second order", "other lag", "further lag"
"""Kinds of amplifier."""
FAR = (3.0, 10.0, 30.0)
"""Lags over that of the rig file that a refit starts from: a coil called ideal has a lag of a sample or less there, and
in truth one of up to thirty; a refit comes down from up to a factor of three."""
LITTLE_SLOWER = 1.01
"""Lag over that of the rig file which a loop bears that is hardly stable."""
FAR_OUT, FASTEST_REAL = 0.1, 0.25
"""Second pole of an amplifier, its lag and its square term over those of the first: far out, and where both are one."""
SHARP, NOISY = 0.004, 0.05
"""Noise of what is limited, over the limit: the least (of what it changes less than 1 % is missed), and the probe."""
CUT = (0.95, 0.8, 0.6, 0.4, 0.25)
"""Parts of a peak at which a limit is probed."""


@dataclass(frozen=True)
class AmplifierBandwidth(Effect):
    """An amplifier of second order, or with another lag than the rig's; the inductance of a voltage-driven coil.

    Attributes
    ----------
    kind : str
        ``second order``; or with one number, ``other lag`` in place of the rig's, ``further lag`` in series with it.
    slower : float
        By how much the lag that is probed is longer than that of the rig file.
    """

    name = "amplifier_bandwidth"
    physics = "the amplifier is of second order, or faster or slower than the lag of the rig file"
    equation = "i'' = w^2 (i_set - i) - 2 zeta w i', w = 2 pi f; of a voltage-driven coil L i' = u - R i"
    signature = "i_c leads or lags at every step of the excitation, with overshoot where it is underdamped"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 3"

    kind: str = SECOND_ORDER
    slower: float = 1.1

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """A little slower, in each way, or less where the loop bears no more; slow against a sample too, if it is not.

        A voltage-driven coil has one lag and no other.
        """
        tau, sample = seen.rig.amplifier.time_constant, 1.0 / seen.rig.sample_rate
        slow = [share * sample / tau for share in (0.1, 0.5)] if 0.0 < tau < 0.05 * sample else []
        if seen.rig.amplifier.resistance is not None:
            return [replace(self, slower=slower) for slower in (self.slower, *slow)]
        little = (self.slower, LITTLE_SLOWER)
        one = [replace(self, slower=slower) for slower in (*little, *slow)]
        return [*one, replace(self, kind=OTHER_LAG), *(replace(self, kind=FURTHER_LAG, slower=s) for s in little)]

    def why_not(self, rig: Rig) -> str:
        """An ideal amplifier."""
        return "" if rig.amplifier.time_constant > 0.0 else IDEAL

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Natural frequency [Hz] and damping ratio, or a lag [s]; of a voltage-driven coil the inductance [H]."""
        if self.why_not(rig):
            return []
        tau, resistance = rig.amplifier.time_constant, rig.amplifier.resistance
        if resistance is not None:
            nominal = resistance * tau
            meaning = "inductance L of the coil"
            return [EffectParameter("inductance", "H", self.slower * nominal, lower=0.01 * nominal, meaning=meaning)]
        if self.kind == OTHER_LAG:
            meaning = "time constant of the amplifier, a first-order lag"
            return [EffectParameter("time_constant", "s", self.slower * tau, lower=0.01 * tau, meaning=meaning)]
        if self.kind == FURTHER_LAG:
            sample = 1.0 / rig.sample_rate
            meaning = "time constant of a first-order lag in series with that of the rig file"
            least, most = 5e-5 * sample, 20.0 * sample
            probe = 0.5 * (self.slower - 1.0) * sample
            return [EffectParameter("further_lag", "s", probe, lower=least, upper=most, meaning=meaning)]
        corner = 1.0 / (2.0 * pi * tau)
        return [
            EffectParameter(
                "frequency_hz",
                "Hz",
                2.0 * corner,
                lower=0.05 * corner,
                upper=1e3 * corner,
                meaning="undamped natural frequency f of the amplifier",
            ),
            EffectParameter("damping", "1", 1.0, lower=0.05, upper=1e3, meaning="its damping ratio zeta"),
        ]

    def probes(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """A longer lag, and as much of second order."""
        if not self._is_second_order(rig):
            return super().probes(rig)
        tau, far = rig.amplifier.time_constant, self._far
        return [
            _of_series(tau * (self.slower + far), tau**2 * far * self.slower),
            _of_series(tau, tau**2 * FASTEST_REAL * far / FAR_OUT),
        ]

    @property
    def _far(self) -> float:
        """Lag of a second pole over that of the first: so far out that the first alone remains."""
        return min(FAR_OUT, self.slower - 1.0)

    def _is_second_order(self, rig: Rig) -> bool:
        return self.kind == SECOND_ORDER and rig.amplifier.resistance is None

    def amplitudes(self, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        """Slower or faster, with more or less of second order; a further lag only delays."""
        count = len(self.parameters(rig))
        return np.full(count, 0.0 if self.kind == FURTHER_LAG else -np.inf), np.full(count, np.inf)

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """From ``1 + p s + q s^2``, to which the probes add more lag and a little curvature, and tau^2/4 alone."""
        if self.kind == FURTHER_LAG:
            return super().start(rig, amplitudes)
        tau, longer = rig.amplifier.time_constant, self.slower
        if not self._is_second_order(rig):
            added = float(np.clip((longer - 1.0) * amplitudes[0], -0.8, 5.0 * longer))
            name, nominal = self._lag(rig)
            return {name: nominal * (1.0 + added)}
        far = self._far
        p = tau * (1.0 + float(np.clip((longer + far - 1.0) * amplitudes[0], -0.8, 4.0 * max(1.0, longer))))
        bend = tau**2 * far * float(longer * amplitudes[0] + FASTEST_REAL / FAR_OUT * amplitudes[1])
        q = float(np.clip(bend, 1e-3 * p**2, 4.0 * p**2))
        return _of_series(p, q)

    @staticmethod
    def _lag(rig: Rig) -> tuple[str, float]:
        """The parameter that stands in place of the rig's lag, and its nominal value."""
        tau, resistance = rig.amplifier.time_constant, rig.amplifier.resistance
        return ("time_constant", tau) if resistance is None else ("inductance", resistance * tau)

    def far_starts(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Of a voltage-driven coil; from a lag that is far too short a score sees nothing of a lag of many samples."""
        name, nominal = self._lag(rig)
        return [] if rig.amplifier.resistance is None else [{name: times * nominal} for times in FAR]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """By how much its lag is longer than that of the rig file."""
        name, nominal = self._lag(rig)
        tau = rig.amplifier.time_constant
        if self._is_second_order(rig):
            longer = values["damping"] / (pi * values["frequency_hz"]) - tau
        else:
            longer = values["further_lag"] if self.kind == FURTHER_LAG else tau * (values[name] / nominal - 1.0)
        return dict.fromkeys((LAG_OF_CURRENT, LAG_ROUND_LOOP), longer)

    def attach(self, plant: Plant) -> None:
        """The true amplifier beside the nominal one, whose current it replaces; a further lag stands before that."""
        for axis in plant.axes:
            if self.kind == FURTHER_LAG:
                asked = plant.raw(f"i_set.{axis}")
                lagging = plant.lag(f"amplifier_further.{axis}", asked, self.slot("further_lag"))
                plant.inject(f"i_set.{axis}", lagging - asked)
                continue
            current = plant.state(f"amplifier.{axis}")
            if self._is_second_order(plant.rig):
                rate = self._second_order(plant, axis, current)
            else:
                (rate,) = plant.of_amplifier(axis, "amplifier", [self._first_order(plant, axis, current)])
            plant.set_rate(f"amplifier.{axis}", rate + plant.cut(axis))
            for name, true in (("i_a", current), ("i_a_free", rate)):
                plant.inject(f"{name}.{axis}", true - plant.raw(f"{name}.{axis}"))

    def _second_order(self, plant: Plant, axis: str, current: Signal) -> Signal:
        """Rate of the current; the second state is that over w."""
        frequency, damping = self.slot("frequency_hz"), self.slot("damping")
        scaled = plant.state(f"amplifier_rate.{axis}")
        drive = plant[f"i_set.{axis}"] - current - plant.port(damping, scaled, scale=2.0)
        rates = [plant.port(frequency, own, scale=2.0 * pi) for own in (scaled, drive)]
        rate, bend = plant.of_amplifier(axis, "amplifier", rates)
        plant.set_rate(f"amplifier_rate.{axis}", bend)
        return rate

    def _first_order(self, plant: Plant, axis: str, current: Signal) -> Signal:
        """Rate of the current."""
        if plant.rig.amplifier.resistance is None:
            slot = self.slot("time_constant")
            return plant.port(slot, plant[f"i_set.{axis}"] - current, power=-1)
        slot, resistance = self.slot("inductance"), f"R.{axis}"
        return plant.port(slot, plant[f"i_ref.{axis}"] - plant.port(resistance, current), power=-1)


def _of_series(p: float, q: float) -> dict[str, float]:
    """The amplifier ``1/(1 + p s + q s^2)``."""
    return {"frequency_hz": float(1.0 / (2.0 * pi * np.sqrt(q))), "damping": max(0.06, float(0.5 * p / np.sqrt(q)))}


def noise_at(limit: float, unit: str) -> EffectParameter:
    """Noise that goes round the loop and rounds the corners of a limit.

    The model is simulated without noise; the mean of what a limit lets through depends on how much there is (Gelb,
    Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, 1968, chapter 7).
    """
    meaning = "standard deviation of the noise that rounds the corners of the limit"
    return EffectParameter("noise", unit, NOISY * limit, lower=SHARP * limit, upper=limit, meaning=meaning)


@dataclass(frozen=True)
class AmplifierVoltageLimit(OneProbe):
    """The supply voltage limits how fast the current can change.

    Attributes
    ----------
    probed : float
        Inverse slew rate that is probed [s/A].
    """

    name = "amplifier_voltage_limit"
    physics = "current slew rate limited by the supply voltage"
    equation = "i_a' = clip((i_ref - i_a)/tau_a, -r, r)"
    signature = "odd; only where the excitation steps or the amplitude is large; i_c late after large steps alone"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, section 4.3"
    size, most = "inverse_slew_rate", 10.0

    probed: float = 1e-4

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Limits that cut more or less off the fastest change that the linear amplifier makes."""
        fastest = seen.peaks["i_a_free"]
        return [AmplifierVoltageLimit(float(1.0 / (share * fastest))) for share in CUT]

    def why_not(self, rig: Rig) -> str:
        """An ideal amplifier."""
        return "" if rig.amplifier.time_constant > 0.0 else IDEAL

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """One over the largest rate of the current [s/A], and the noise of that rate."""
        if self.why_not(rig):
            return []
        meaning, noise = "one over the largest rate r of the current", noise_at(1.0 / self.probed, "A/s")
        return [EffectParameter("inverse_slew_rate", "s/A", self.probed, upper=1.0, meaning=meaning), noise]

    def attach(self, plant: Plant) -> None:
        """What the limit cuts off, rounded at the corners."""
        slots = {"inverse_limit": self.slot("inverse_slew_rate"), "noise": self.slot("noise")}
        for axis in plant.axes:
            cut = plant.block("limit", [plant[f"i_a_free.{axis}"]], slots)
            plant.inject(f"i_a_rate.{axis}", cut)


@dataclass(frozen=True)
class CommandSaturation(OneProbe):
    """The controller's output ends at a limit.

    Attributes
    ----------
    probed : float
        One over the limit that is probed, in the unit of commands.
    """

    name = "command_saturation"
    physics = "the command ends at a limit, of the converter or of the controller"
    equation = "i_ref = clip(-K y + i_e, -r, r)"
    signature = "odd; only where the command is large; i_c cut off at the peaks of the command alone"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 8"
    size, most = "inverse_limit", 10.0

    probed: float = 1.0

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """Limits that cut more or less off the peaks of the command."""
        return [CommandSaturation(float(1.0 / (share * seen.peaks["i_ref"]))) for share in CUT[::2]]

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """One over the limit, and the noise of the command."""
        unit = f"1/{rig.amplifier.command_unit}"
        limit = EffectParameter("inverse_limit", unit, self.probed, meaning="one over the largest command r")
        return [limit, noise_at(1.0 / self.probed, rig.amplifier.command_unit)]

    def attach(self, plant: Plant) -> None:
        """What the limit cuts off, rounded at the corners."""
        slots = {name: self.slot(name) for name in ("inverse_limit", "noise")}
        for axis in plant.axes:
            command = plant.raw(f"i_ref.{axis}")
            plant.inject(f"i_ref.{axis}", plant.block("limit", [command], slots))


@dataclass(frozen=True)
class LoopDelay(Effect):
    """A delay, exact: commands reach the plant between samples; see `loop.delay` for the feedback of analog ones."""

    name = "loop_delay"
    physics = "everything that leaves the controller, feedback and excitation, reaches the amplifier late"
    equation = "i_ref(t) = (-K y + i_e)(t - delay)"
    signature = "phase that falls with frequency in y and i_c, most in i_c at every step of the excitation"
    source = "Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., section 5.7"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """The delay [s]."""
        sample = 1.0 / rig.sample_rate
        meaning = "by how much commands reach the amplifier late"
        return [EffectParameter("delay", "s", 0.05 * sample, lower=5e-5 * sample, upper=20.0 * sample, meaning=meaning)]

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """The delay."""
        return dict.fromkeys((LAG_OF_CURRENT, LAG_ROUND_LOOP), values["delay"])

    def attach(self, plant: Plant) -> None:
        """Feedback and excitation alike."""
        plant.delay_commands(self.slot("delay"))


EFFECTS = (
    AmplifierBandwidth(),
    AmplifierVoltageLimit(),
    CommandSaturation(),
    LoopDelay(),
)
