"""What a physical effect is: a hypothesis that adds blocks to Delta and is absent from the base model."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, fields, is_dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from ambid.arrays import FloatArray
from ambid.findings import Finding
from ambid.loop.geometry import why_unknown
from ambid.loop.plant import Plant
from ambid.record import Record
from ambid.rig import Rig


@dataclass(frozen=True)
class Tone:
    """A line of the residual that belongs to no excitation.

    Attributes
    ----------
    frequency_hz : float
    channel : int
        Of y of all axes, then i_c of all axes, the one that holds most of it, in units of its noise.
    power : float
        Largest power of a channel over the noise around.
    """

    frequency_hz: float
    channel: int
    power: float


@dataclass(frozen=True)
class Seen:
    """What the model and the records show before any candidate is tried.

    Attributes
    ----------
    rig : Rig
    peaks : mapping of str to float
        Largest absolute value of signals of the plant over all axes and records: ``s``, ``i_f``, ``i_f_rate``,
        ``i_a_free``; rates where there are lags.
    tones : sequence of Tone
        Lines of the residual that belong to no excitation.
    held : sequence of float
        Mean current of each axis, which holds the weight of the rotor [A]; empty where it was not recorded.
    points : sequence of Rig
        Further operating points that there are records of.
    across_planes : bool
        Whether an effect of the model makes one plane act on the other.
    """

    rig: Rig
    peaks: Mapping[str, float]
    tones: Sequence[Tone] = ()
    held: Sequence[float] = ()
    points: Sequence[Rig] = ()
    across_planes: bool = False

    @property
    def speeds(self) -> frozenset[float]:
        """Of all operating points [rad/s]."""
        return frozenset(rig.speed for rig in (self.rig, *self.points))


@dataclass(frozen=True)
class EffectParameter:
    """An uncertain number that an effect brings.

    Attributes
    ----------
    name : str
        Without the effect's name, such as ``stiffness``.
    unit : str
        ``1`` for a ratio.
    probe : float
        A typical small value, in `unit`: the response is probed with it, and the optimiser scales by it.
    lower, upper : float
        What physics allows.
    meaning : str
        What it is, in a few words.
    std : float or None
        Standard deviation from 0 to which it is known before any record, in `unit`; None where nothing is known.
    """

    name: str
    unit: str
    probe: float
    lower: float = 0.0
    upper: float = float("inf")
    meaning: str = ""
    std: float | None = None


SETTING_UNITS = {"z": "m", "frequency_hz": "Hz"}
"""Of settings that a diagnosis estimates."""


@dataclass(frozen=True)
class Trait:
    """A number that the effects of a family share, such as the lag between two signals.

    Attributes
    ----------
    what : str
        With its article, such as ``a lag``.
    where : str
        Between which signals, or at which place.
    unit : str
        ``1`` for a ratio.
    opposite : str
        What a negative number is, such as ``a lead``; empty where it is the same with a minus sign.
    """

    what: str
    where: str
    unit: str
    opposite: str = ""


class Effect(ABC):
    """A physical effect. Subclass it for one of your own; it is then ranked beside those of the catalogue.

    Settings that distinguish its variants, such as a place or a frequency, are the fields of a frozen dataclass: repr,
    equality and what is saved with a model follow from them. An effect without settings may be a plain class.

    Attributes
    ----------
    name : str
        Identifier, such as ``loop_delay``.
    physics, signature, source : str
        A sentence each: what happens, how it shows in the residual, where it is described.
    equation : str
        What it adds to the equations of the loop, in a line of plain text.
    contains : tuple of str
        Names of simpler effects that this one includes; where one of them does as well, it is named instead.
    plural : bool
        Whether its name is a plural.
    across_planes : bool
        Whether it makes one plane of the rotor act on the other.
    within_command : bool
        Whether it is an error of what makes the command: an i_e that was rebuilt from the recorded command holds it.
    in_record : bool
        Whether it is an error of the record alone, which the machine does not have.
    formula_error : float
        Part of what it explains that its formula may leave.
    usual_error : float or None
        The part that it leaves as a rule, which speaks for nothing else; by default all of `formula_error`.
    unseen : str
        Why it is not tried where it has no `variants`.
    fine : tuple of str
        Settings that are numbers, such as a place `z` or a `frequency_hz`: from the values that are tried, a diagnosis
        moves them to where J is least.
    in_series : mapping of str to str
        Of its parameters, those that a parameter of the base model may be exchanged with: lags of one order, one behind
        the other. Told is then the pair in which the base parameter is nearer to the rig file.
    """

    name: ClassVar[str]
    physics: ClassVar[str]
    signature: ClassVar[str]
    source: ClassVar[str]
    equation: ClassVar[str] = ""
    contains: ClassVar[tuple[str, ...]] = ()
    plural: ClassVar[bool] = False
    across_planes: ClassVar[bool] = False
    within_command: ClassVar[bool] = False
    in_record: ClassVar[bool] = False
    formula_error: ClassVar[float] = 0.0
    usual_error: ClassVar[float | None] = None
    fine: ClassVar[tuple[str, ...]] = ()
    in_series: ClassVar[Mapping[str, str]] = MappingProxyType({})
    unseen: ClassVar[str] = "the records show nothing that it could be tried at"

    @property
    def leaves_as_a_rule(self) -> float:
        """Part of what it explains that its formula leaves as a rule."""
        return self.formula_error if self.usual_error is None else self.usual_error

    def __post_init__(self) -> None:
        """Take lists, as files hold them, for tuples."""
        for name, value in vars(self).items():
            if isinstance(value, list):
                object.__setattr__(self, name, tuple(value))

    @abstractmethod
    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Parameters of the effect on this rig; none where it makes no sense, such as unbalance at rest."""

    @abstractmethod
    def attach(self, plant: Plant) -> None:
        """Add states, ports and injections to the plant; ports fill the slots ``<effect>.<parameter>``."""

    def why_not(self, rig: Rig) -> str:
        """Why the effect is not tried on this rig, such as "the rotor does not turn"; empty where it makes sense.

        By default it is tried where it has parameters, and where the rotor is known at its `positions`.
        """
        return why_unknown(rig, self.positions(rig)) if self.parameters(rig) else "it has no parameters on this rig"

    def variants(self, seen: Seen) -> Sequence[Effect]:
        """The effect at each place, frequency or size where it is to be tried; the best of them is ranked.

        None where the records show nothing of it.
        """
        return (self,)

    def waveform(self, rig: Rig, samples: int, record: Record | None) -> FloatArray:
        """Known inputs, shape (samples, k), that drive the plant's inputs of this effect, in their order.

        They are held from sample to sample. `record` is the record that is being simulated, if there is one.
        """
        return np.zeros((samples, 0))

    def frequencies_hz(self, rig: Rig) -> Sequence[float]:
        """Frequencies of its own, whose lines of the spectrum are judged beside the excited ones."""
        return ()

    def quarters(self, rig: Rig) -> Sequence[tuple[str, str]]:
        """Pairs of parameters that are a quarter period of a wave apart.

        The angle that a record begins at turns them into each other; see `Comparison.with_own_angles`.
        """
        return ()

    def traits(self, rig: Rig, values: Mapping[str, float]) -> Mapping[Trait, float]:
        """What it shares with effects of its family, the narrowest first, and how large that is at parameter values.

        Effects that share a trait can be taken for each other; see `ambid.effects.traits`. NaN where it is no one
        number.
        """
        return {}

    def findings(self, rig: Rig, values: Mapping[str, float] | None) -> Sequence[Finding]:
        """What a person must know where a diagnosis names the effect, at the values found of its parameters.

        None in place of values: another effect is named, and this one does as well.
        """
        return ()

    def mended(self, record: Record, values: Mapping[str, float]) -> Record:
        """The record without what it holds of the effect at these values; physics stays."""
        return record

    def corrected(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """The rig with what of the effect is an error of its file set right; physics stays."""
        return rig

    def settings(self) -> dict[str, Any]:
        """Arguments of the constructor that make this variant, as saved with a model: fields that are not default."""
        own: tuple[Field[Any], ...] = fields(self) if is_dataclass(self) else ()
        return {field.name: value for field in own if (value := getattr(self, field.name)) != field.default}

    def fine_settings(self) -> dict[str, tuple[float, str]]:
        """Value and unit of each of its `fine` settings that has one, by names such as ``seal_forces.z``."""
        own = {name: getattr(self, name) for name in self.fine if getattr(self, name) is not None}
        return {self.slot(name): (float(value), SETTING_UNITS.get(name, "1")) for name, value in own.items()}

    def without_probe(self) -> Effect:
        """The variant with the same loop and no settings that only its probe has: so that it is compiled once."""
        return self

    def positions(self, rig: Rig) -> Sequence[float]:
        """Axial positions at which it acts, beside magnets and sensors [m]."""
        return ()

    def flexible_modes(self, rig: Rig) -> int:
        """Bending modes per plane that the rotor must have for it, beyond those of the rig."""
        return 0

    def probes(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Sets of parameter values whose responses span the effect; by default one parameter at a time."""
        own = self.parameters(rig)
        return [{p.name: p.probe if p is one else 0.0 for p in own} for one in own]

    def amplitudes(self, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        """How much of each probe physics allows: lower and upper bounds; by default those of the parameters."""
        own = self.parameters(rig)
        return np.array([p.lower / p.probe for p in own]), np.array([p.upper / p.probe for p in own])

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """Values to start a refit from, given how much of each probe the residual calls for."""
        start = {}
        for amplitude, p in zip(amplitudes, self.parameters(rig), strict=True):
            below = 10.0 if np.isfinite(p.lower) else 100.0
            least, most = max(p.lower, -below * p.probe), min(p.upper, 100.0 * p.probe)
            wanted = amplitude if abs(amplitude) > 1e-6 else 0.1
            start[p.name] = float(min(max(wanted * p.probe, least), most))
        return start

    def far_starts(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """Values far from the rig file's where a refit starts too, for an effect whose score cannot see so far."""
        return ()

    def slot(self, parameter: str) -> str:
        """Name of a parameter in the model, such as ``loop_delay.delay``."""
        return f"{self.name}.{parameter}"


class OneProbe(Effect):
    """An effect whose one probe has all parameters at their probes: how much of it there is, is in proportion to one.

    Attributes
    ----------
    size : str
        The parameter that is 0 where the effect is absent, and never less.
    most : float
        How much of the probe physics allows.
    refitted : tuple of float
        Least and most of it that a refit starts from; by default all of the probe.
    """

    size: ClassVar[str]
    most: ClassVar[float] = float("inf")
    refitted: ClassVar[tuple[float, float]] = (1.0, 1.0)

    def probes(self, rig: Rig) -> Sequence[Mapping[str, float]]:
        """One, of this variant."""
        return [{p.name: p.probe for p in self.parameters(rig)}]

    def amplitudes(self, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        """Nothing or any size."""
        return np.zeros(1), np.full(1, self.most)

    def start(self, rig: Rig, amplitudes: Sequence[float]) -> dict[str, float]:
        """The probe, with the size that the residual calls for."""
        wanted = float(np.clip(amplitudes[0], *self.refitted))
        return {p.name: p.probe * (wanted if p.name == self.size else 1.0) for p in self.parameters(rig)}
