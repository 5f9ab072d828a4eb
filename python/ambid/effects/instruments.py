"""Instruments that read further signals: gains and instants that are known to a tolerance, where channels need them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ambid.channels import SIGNALS, further
from ambid.effects.known import Known, KnownInstant
from ambid.loop.effect import Effect
from ambid.loop.plant import READ, SENSED, Plant
from ambid.rig import Rig


@dataclass(frozen=True)
class KnownGain(Known):
    """Gains of instruments beside those of y and i_c.

    Attributes
    ----------
    name : str
        Key of [tolerance].
    channels : tuple of str
        That they read, such as ``b.A_zeta``.
    """

    name: str  # type: ignore[misc]
    channels: tuple[str, ...]
    no_key = "the channel is as it was recorded: correct its calibration"
    physics = "the gain of an instrument"
    equation = "x = (1 + g) x_true"

    @property
    def key(self) -> str:  # type: ignore[override]
        """That of [tolerance]."""
        return self.name

    def members(self, rig: Rig) -> Sequence[str]:
        """The axes and sensors of the channels that the rig has."""
        return [channel.partition(".")[2] for channel in self.channels if not rig.lacks(channel)]

    def attach(self, plant: Plant) -> None:
        """At every channel."""
        for channel in self.channels:
            if not plant.rig.lacks(channel):
                slot = self.slot(channel.partition(".")[2])
                plant.inject(READ + channel, plant.port(slot, plant.raw(READ + channel)))


@dataclass(frozen=True)
class KnownInstants(Known):
    """Instants at which further signals are read, against those of y.

    Attributes
    ----------
    channels : tuple of str
    """

    name = key = "instant"
    unit = "s"
    no_key = KnownInstant.no_key.replace("i_c", "the channel")
    physics = "the instants at which further instruments are read"
    equation = "x(t + d)"

    channels: tuple[str, ...]

    def members(self, rig: Rig) -> Sequence[str]:
        """Signals, all channels of each together."""
        return list(dict.fromkeys(channel.partition(".")[0] for channel in self.channels if not rig.lacks(channel)))

    def attach(self, plant: Plant) -> None:
        """At every channel that is read."""
        for channel in self.channels:
            if channel in plant.measured:
                plant.record_late(channel, self.slot(channel.partition(".")[0]), -1.0)


@dataclass(frozen=True)
class KnownCoil(Known):
    """Resistance or inductance of coils whose current is commanded and whose voltage is read.

    Attributes
    ----------
    name : str
        Key of [tolerance], and of the amplifier.
    channels : tuple of str
        Voltages, such as ``u.A_zeta``.
    """

    name: str  # type: ignore[misc]
    channels: tuple[str, ...]
    no_key = "the rig file has one value for all axes: correct it to their mean"
    physics = "the resistance or the inductance of the coils of an axis"
    equation = "u = (1 + d_R) R i + (1 + d_L) L di/dt + K_i v"

    @property
    def key(self) -> str:  # type: ignore[override]
        """That of [tolerance]."""
        return self.name

    def members(self, rig: Rig) -> Sequence[str]:
        """The axes of the channels, where the coils are known."""
        return [] if getattr(rig.amplifier, self.name) is None else [own.partition(".")[2] for own in self.channels]

    def attach(self, plant: Plant) -> None:
        """At every voltage."""
        value, signal = getattr(plant.rig.amplifier, self.name), {"coil_resistance": "i_a"}.get(self.name, "i_a_rate")
        for axis in self.members(plant.rig):
            plant.inject(f"{SENSED}u.{axis}", plant.port(self.slot(axis), value * plant[f"{signal}.{axis}"]))


Instrument = KnownGain | KnownCoil | KnownInstants


def instruments_of(channels: Sequence[str], rig: Rig) -> tuple[Instrument, ...]:
    """Coils, gains, one for every key of [tolerance], and instants of the instruments, where these are not exact."""
    found: dict[str, list[str]] = {}
    for channel in channels:
        found.setdefault(SIGNALS[channel.partition(".")[0]].gain, []).append(channel)
    voltages = tuple(own for own in channels if own.startswith("u."))
    every: list[Instrument] = [KnownCoil(name, voltages) for name in ("coil_resistance", "coil_inductance")]
    every += [KnownGain(key, tuple(own)) for key, own in found.items()]
    return tuple(own for own in (*every, KnownInstants(tuple(channels))) if own.parameters(rig))


def with_instruments(known: tuple[Effect, ...], channels: Iterable[str], rig: Rig) -> tuple[Effect, ...]:
    """Known values, if any, with those of the instruments that read further channels."""
    had = list(dict.fromkeys(channel for own in known if isinstance(own, Instrument) for channel in own.channels))
    new = [channel for channel in dict.fromkeys(further(channels, rig.axes)) if channel not in had]
    if not known or not new:
        return known
    return (*(own for own in known if not isinstance(own, Instrument)), *instruments_of([*had, *new], rig))


def instruments_among(parameters: Iterable[str], rig: Rig) -> tuple[Instrument, ...]:
    """Those that the parameters of a model are of, by their names: ``flux_gain.A_zeta``, ``instant.b``."""
    signals, channels = {own.gain: name for name, own in SIGNALS.items() if own.gain}, list[str]()
    for key, place in (name.partition(".")[::2] for name in parameters):
        if key in signals:
            channels.append(f"{signals[key]}.{place}")
        elif key == KnownInstants.key and place:
            channels += [output for output in rig.outputs if output.startswith(f"{place}.")]
    return instruments_of(list(dict.fromkeys(further(channels, rig.axes))), rig)
