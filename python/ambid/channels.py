"""The signals that records hold, one list: what each is, its unit, how it is printed, and which noise it has."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Literal, NamedTuple

__all__ = [
    "FURTHER",
    "SIGNALS",
    "Channel",
    "SensorSignal",
    "SignalType",
    "by_signal",
    "first_outputs",
    "further",
    "in_order",
    "read_in",
    "unit_of",
]


@dataclass(frozen=True)
class SignalType:
    """A signal that a record may hold.

    Attributes
    ----------
    name : str
        What the names of its channels begin with.
    unit : str
    meaning : str
    path : {"drive", "command", "heard", "recorder"}
        What drives the loop; the command that leaves the controller; an output whose noise goes round the loop where
        the controller reads it; an output whose noise is of the recorder alone.
    at : tuple of {"axis", "sensor"}
        What its channels are of: an axis of the rig, or a ``[[sensor]]``.
    gain : str
        Key of the rig file's [tolerance] for the gain of the instrument; empty where it has none.
    most : float
        Largest value that a sound record has, in `unit`.
    slip : str
        What larger values look like.
    instrument : str
        What reads it, in the plural.
    """

    name: str
    unit: str
    meaning: str
    path: Literal["drive", "command", "heard", "recorder"]
    at: tuple[Literal["axis", "sensor"], ...] = ("axis",)
    gain: str = ""
    most: float = inf
    slip: str = ""
    instrument: str = ""


_EVERY = (
    SignalType("i_e", "A", "excitation", "drive"),
    SignalType("r", "m", "reference of the controller", "drive"),
    SignalType(
        "y",
        "m",
        "displacement at a sensor",
        "heard",
        ("axis", "sensor"),
        "sensor_gain",
        instrument="displacement sensors",
    ),
    SignalType("i_c", "A", "control current", "heard", gain="current_gain", instrument="current sensors"),
    SignalType("i_ref", "A", "command that reaches the amplifier", "command"),
    # beyond twice 2.4 T, where cobalt iron, the best there is, saturates
    SignalType(
        "b",
        "T",
        "flux density in the gap, opposed poles",
        "recorder",
        gain="flux_gain",
        most=4.8,
        slip="mT",
        instrument="Hall sensors",
    ),
    SignalType("u", "V", "coil voltage", "recorder", gain="voltage_gain", instrument="voltage probes"),
    SignalType("f", "N", "magnet force", "recorder", gain="force_gain", instrument="load cells"),
    SignalType(
        "a",
        "m/s^2",
        "acceleration at a sensor",
        "recorder",
        ("sensor",),
        "acceleration_gain",
        instrument="accelerometers",
    ),
)
SIGNALS = {own.name: own for own in _EVERY}
"""By name, in the order of the columns of a file."""
SensorSignal = Literal["a", "y"]
"""Those that a ``[[sensor]]`` may read."""
FURTHER = tuple(own.name for own in _EVERY if own.path == "recorder")
"""Signals beyond y and i_c that a record may hold."""
_SHOWN = {"m": (1e6, "um"), "A": (1e3, "mA"), "T": (1e3, "mT"), "m/s^2": (1.0, "m/s^2")}


class Channel(NamedTuple):
    """A channel of a record: its signal, and the axis or sensor that it is of."""

    signal: SignalType
    place: str

    @classmethod
    def of(cls, name: str) -> Channel | None:
        """By its name, such as ``b.A_zeta``; None where that is none of ours."""
        signal, _, place = name.partition(".")
        return cls(SIGNALS[signal], place) if signal in SIGNALS and place else None

    @property
    def name(self) -> str:
        """Such as ``b.A_zeta``."""
        return f"{self.signal.name}.{self.place}"


def in_order(channels: Iterable[str], axes: Sequence[str]) -> list[str]:
    """The channels signal by signal in the order of `SIGNALS`, those of axes first in theirs, then sensors by name."""
    places, signals = {axis: k for k, axis in enumerate(axes)}, list(SIGNALS)

    def place(name: str) -> tuple[int, int, str]:
        signal, _, place = name.partition(".")
        return signals.index(signal), places.get(place, len(places)), place

    return sorted(channels, key=place)


def unit_of(channel: str) -> str:
    """Unit of a channel such as ``b.A_zeta``, or of a signal such as ``b``."""
    return SIGNALS[channel.partition(".")[0]].unit


def further(channels: Iterable[str], axes: Sequence[str]) -> tuple[str, ...]:
    """Those of the channels that are neither y nor i_c of an axis."""
    usual = {f"{signal}.{axis}" for axis in axes for signal in ("y", "i_c")}
    return tuple(name for name in channels if name not in usual)


def by_signal(channels: Iterable[str]) -> dict[str, list[str]]:
    """The channels by the name of their signal, each in its order."""
    found: dict[str, list[str]] = {}
    for channel in channels:
        found.setdefault(channel.partition(".")[0], []).append(channel)
    return found


@lru_cache(maxsize=256)
def first_outputs(channels: tuple[str, ...], axes: tuple[str, ...]) -> tuple[str, ...]:
    """Outputs that a loop is to have first so that it has these channels: y, if any is there, then the others.

    None where it has them anyway: where they are y and i_c of axes alone.
    """
    if not further(channels, axes):
        return ()
    y = [f"y.{axis}" for axis in axes]
    has_y = not set(y).isdisjoint(channels)
    return (*(y if has_y else ()), *(name for name in channels if name not in y))


def read_in(unit: str) -> tuple[float, str]:
    """Factor and name of the unit that tables print a value in, that of a response such as ``m/A`` too."""
    if unit in _SHOWN:
        return _SHOWN[unit]
    of, slash, by = unit.rpartition("/")
    if not slash:
        return 1.0, unit
    factor, shown = read_in(of)
    return factor, f"{shown}/{by}"
