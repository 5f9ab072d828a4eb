"""Quantities and units as instruments write them: the factors that make SI units, and complex values in Hz."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.constants import foot, g, inch

from ambid.arrays import ComplexArray, FloatArray
from ambid.channels import Channel
from ambid.errors import RecordError
from ambid.findings import Finding, Kind

UNITS_ASSUMED = Kind(
    "units_assumed",
    "note",
    "units are not stated and taken by the values: {units}",
    "name the columns with their units, such as frequency_hz, magnitude_db, phase_deg, or map them",
)
UNITS_CONVERTED = Kind("units_converted", "note", "{channels}: {found} converted to {unit}")
INTEGRATIONS = {"displacement": 0, "velocity": 1, "acceleration": 2}
_LENGTHS = {
    **{"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "micron": 1e-6, "microns": 1e-6, "nm": 1e-9},
    **{"in": inch, "inch": inch, "ft": foot, **dict.fromkeys(("mil", "mils", "thou"), 1e-3 * inch)},
}
_FORMS = {"displacement": ("",), "velocity": ("/s", "/sec"), "acceleration": ("/s2", "/sec2", "/s/s", "/sec/sec")}
_UNITS = {
    **{
        f"{length}{form}": (kind, factor)
        for kind, forms in _FORMS.items()
        for form in forms
        for length, factor in _LENGTHS.items()
    },
    "ips": ("velocity", inch),
    **dict.fromkeys(("g", "gn", "g's"), ("acceleration", g)),
    "mg": ("acceleration", 1e-3 * g),
    "gal": ("acceleration", 1e-2),
    **{"a": ("current", 1.0), "amp": ("current", 1.0), "ma": ("current", 1e-3), "ua": ("current", 1e-6)},
    **{"v": ("voltage", 1.0), "volt": ("voltage", 1.0), "mv": ("voltage", 1e-3), "uv": ("voltage", 1e-6)},
}
_FREQUENCIES = {
    **{"hz": 1.0, "khz": 1e3, "1/s": 1.0},
    **dict.fromkeys(("rad/s", "rad/sec"), 0.5 / np.pi),
    **dict.fromkeys(("rpm", "1/min", "r/min", "cpm", "rev/min", "u/min", "min-1"), 1.0 / 60.0),
}
_ASSUMED = {"": "Hz", "rad/timeunit": "rad/s"}
"""Units of frequencies that state none; the second one is of MATLAB, whose unit of time is s unless it is changed."""
_ANGULAR = ("omega", "w", "ω", "angular frequency")
"""Names of frequencies in rad/s."""
_AMPLITUDE = re.compile(r"[\s_]*(pk-pk|p-p|peak|pk|rms)\s*$")
DECIBEL = "db"
WORDS = {
    "frequency": ("frequency", "freq", "f", "frequenz", *_ANGULAR),
    "magnitude": ("magnitude", "mag", "gain", "amplitude", "abs", "modulus", "ampl", "betrag"),
    "phase": ("phase", "angle", "arg"),
    "re": ("re", "real"),
    "im": ("im", "imag", "imaginary"),
    "coherence": ("coherence", "coh"),
    "averages": ("averages", "average count", "n_avg"),
    "std": ("std",),
    "spread": ("spread",),
    "output": ("output", "response"),
    "input": ("input", "reference", "excitation"),
}
"""Names of columns without their units, in small letters; the first one is ours."""
PHASES = {
    **dict.fromkeys(("deg", "degree", "degrees", "°", "grad"), np.pi / 180.0),
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
}
PLAIN = ("abs", "lin", "linear", "1", "-", "ratio")
"""Units of a magnitude that is no level and states none."""
SIGNALS = ("y", "i_c", "i_e", "r")
FORMS = (("re", "im"), ("magnitude", "phase"))
VALUES = ("magnitude", "phase", "re", "im")
"""Quantities that a label may stand beside."""
SPEED = "speed"
"""Quantity of a column whose unit alone is one of frequency or speed: the frequency of a table that names none."""


@dataclass(frozen=True)
class Unit:
    """What is measured, and the factor that makes SI units of it.

    Attributes
    ----------
    kind : {"displacement", "velocity", "acceleration", "current", "voltage"}
    factor : float
        To m, m/s, m/s^2, A or V.
    """

    kind: str
    factor: float


@dataclass(frozen=True)
class Quantity:
    """What a column holds.

    Attributes
    ----------
    name : str
        A key of `WORDS`, or `SPEED`.
    unit : str
        As it is written, empty where none is.
    is_ours : bool
        Whether the column has a name of ours, which says its unit.
    label : str
        What else its name says, such as ``y`` of ``Mag y [dB]``.
    """

    name: str
    unit: str = ""
    is_ours: bool = False
    label: str = ""


OURS = {
    "frequency_hz": Quantity("frequency", "hz", True),
    "frequency_rad_s": Quantity("frequency", "rad/s", True),
    "frequency_rpm": Quantity("frequency", "rpm", True),
    "magnitude": Quantity("magnitude", "abs", True),
    "magnitude_db": Quantity("magnitude", DECIBEL, True),
    "phase_deg": Quantity("phase", "deg", True),
    "phase_rad": Quantity("phase", "rad", True),
    **{
        name: Quantity(name, is_ours=True)
        for name in ("output", "input", "re", "im", "std", "coherence", "averages", "spread")
    },
}
"""By our names of columns and variables."""


def unit_of(text: str) -> Unit | None:
    """The unit that a text names, such as ``mm/s`` or ``µm``; None for an unknown one."""
    found = _UNITS.get(_plain_unit(text))
    return None if found is None else Unit(*found)


def ratio_of(text: str) -> tuple[Unit, Unit | None] | None:
    """Units of a response, such as ``um/A``, and of its excitation if that is named; None for unknown ones.

    Both may be of peaks, or of rms: ``mm/A pk`` or ``mm rms/A rms``.
    """
    whole = unit_of(text)
    if whole is not None:
        return whole, None
    above, _, below = text.lower().rpartition("/")
    if (of_both := _AMPLITUDE.search(below)) is not None:
        above, below = above.rstrip().removesuffix(of_both[1]), below[: of_both.start()]
    upper, lower = unit_of(above), unit_of(below)
    return None if upper is None or lower is None else (upper, lower)


def frequency_unit(text: str) -> float | None:
    """Factor that makes Hz of a unit of frequency or speed, such as ``rad/s`` or ``rpm``; None for an unknown one."""
    return _FREQUENCIES.get(_plain_unit(text))


def _plain_unit(text: str) -> str:
    """Small letters without blanks, powers and brackets, so that one way of writing is left of many."""
    own = re.sub(r"[\s()\[\]^]|\*\*", "", text.lower()).replace("²", "2")
    return own.replace("µ", "u").replace("μ", "u").replace("·", "*")


def quantity_of(header: str) -> Quantity | None:
    """What a column holds by its name, such as ``phase_rad``, ``Magnitude (dB)`` or ``Freq [Hz]``; None for another."""
    if header in OURS:
        return OURS[header]
    text = header.rpartition(": ")[2].strip()
    if text.lower() in OURS:
        return OURS[text.lower()]
    for name, is_named in (
        ("frequency", frequency_unit(text)),
        ("magnitude", text.lower() == DECIBEL),
        ("phase", text.lower() in PHASES),
    ):
        if is_named:
            return Quantity(name, text)  # by its unit alone
    in_brackets = re.fullmatch(r"(.*?)[\s_]*[\[(]([^\[(]*)[\])]", text)
    base, unit = in_brackets.groups() if in_brackets else (text, "")
    if (found := _named(base)) is None and not in_brackets:
        base, unit = re.fullmatch(r"([^\s_]*)[\s_,]*(.*)", text).groups()  # type: ignore[union-attr]
        unit = unit.replace("_", "/")
        found = _named(base) if _is_unit(unit) else None
    if found is None or any(own.partition(".")[0] in (*SIGNALS, "h") for own in unit.split("/")):
        return _labelled(text)
    return Quantity(found, "rad/s" if base.lower() in _ANGULAR and not unit else unit.strip())


def _labelled(text: str) -> Quantity | None:
    """Of a name that says more, such as ``Mag y``, ``Phase(H) / deg``, ``CH2 Gain{dB}`` or ``|y/i_e|, dB``."""
    unit, base = "", text
    for pattern in (r"(.+?)\s*[\[({<]\s*([^\[({<]*?)\s*[\])}>]", r"(.+?)(?:\s*[/,]\s*|[\s_]+(?:in\s+)?)([^\s,]+)"):
        own = re.fullmatch(pattern, base)
        if own and own[2] and _is_unit(own[2]):
            base, unit = own.groups()
            break
    size = re.fullmatch(r"(.*?)\|(.+)\|(.*)", base)
    base = f"magnitude {' '.join(size.groups())}" if size else base.replace("∠", "phase ").replace("<)", "phase ")
    first, *words = re.findall(r"[^\s()\[\]{}<>,:]+", base) or [""]
    named = {name: word for word in (first, *words) if (name := _named(word)) in VALUES}
    if not named and (of_first := _named(first)) in ("frequency", "coherence"):
        named = {of_first: first}
    if not named and frequency_unit(unit) is not None:
        return Quantity(SPEED, unit)
    if len(named) != 1:
        return None
    ((name, own_word),) = named.items()
    return Quantity(str(name), unit, label=" ".join(word for word in (first, *words) if word != own_word).lower())


def holds_quantities(headers: Iterable[str], *, needs_frequency: bool) -> bool:
    """Whether columns of these names are a table of frequency responses; without a named frequency, if it need be."""
    found = [quantity for header in headers if (quantity := quantity_of(header)) is not None]
    names = {own.name for own in found}
    if any(own.is_ours for own in found if own.name == "frequency"):
        return True
    is_whole = any(set(form) <= names for form in FORMS)
    return is_whole and not needs_frequency or "frequency" in names and not names.isdisjoint(VALUES)


def hz_of(path: Path, column: str, quantity: Quantity, values: FloatArray) -> tuple[FloatArray, dict[str, str]]:
    """Frequencies [Hz] of a column, and its unit by column where that is assumed."""
    assumed = _ASSUMED.get(quantity.unit.lower())
    factor = frequency_unit(assumed or quantity.unit)
    if factor is None:
        raise RecordError(f"{path}: {column}: the unit {quantity.unit!r} is unknown; expected Hz, rad/s or rpm")
    return values * factor, {column: assumed} if assumed else {}


def values_of(
    path: Path,
    columns: Mapping[str, tuple[str, Quantity]],
    values: Mapping[str, FloatArray],
    hz: FloatArray,
    outputs: Sequence[str],
) -> tuple[ComplexArray, dict[str, str], list[Finding]]:
    """Complex values from real and imaginary part, or from magnitude and phase, in SI units.

    Velocities and accelerations of a displacement are integrated.

    Parameters
    ----------
    path : Path
        For the messages.
    columns : mapping
        Column and quantity of re and im, or of magnitude and phase.
    values : mapping
        The same in numbers, as they are stored.
    hz : ndarray
        Frequencies of the values [Hz].
    outputs : sequence of str
        Of the values, whose unit a magnitude may state.

    Returns
    -------
    values : ndarray
    assumed : dict of str to str
        Units that are assumed, by column.
    findings : list of Finding
        What was integrated.
    """
    if "re" in columns:
        return values["re"] + 1j * values["im"], {}, []
    assumed: dict[str, str] = {}
    column, quantity = columns["magnitude"]
    unit, size = quantity.unit, values["magnitude"]
    if not unit:
        unit = _unit_of_gain(path, column, size)
        assumed[column] = "dB" if unit == DECIBEL else "1"
    level = re.fullmatch(r"db[\s(\[/]*(?:re)?[\s1]*(.*?)[)\]]?", unit, re.IGNORECASE)
    reference = level.group(1) if level else unit
    if level:
        size = 10.0 ** (size / 20.0)
    factor: ComplexArray | float = 1.0
    findings: list[Finding] = []
    if reference and reference.lower() not in PLAIN:
        factor, findings = _si(path, column, reference, hz, outputs)
    if (size < 0.0).any():
        row = int(np.argmax(size < 0.0))
        raise RecordError(
            f"{path}: {column}, row {row + 1}: {size[row]:g}; a magnitude is not below 0: name the column magnitude_db "
            "if it is in dB"
        )
    column, quantity = columns["phase"]
    unit = quantity.unit.lower()
    if not unit:
        unit = _unit_of_phase(path, column, values["phase"])
        assumed[column] = unit
    if unit not in PHASES:
        raise RecordError(f"{path}: {column}: the unit {quantity.unit!r} is unknown; expected deg or rad")
    return factor * size * np.exp(1j * PHASES[unit] * values["phase"]), assumed, findings


def integrated(hz: FloatArray, order: FloatArray | int) -> ComplexArray:
    """Factor that integrates as many times as `order` says; a line at 0 Hz, which is not used, is left as it is."""
    return np.asarray((2j * np.pi * np.where(hz == 0.0, 1.0, hz)) ** -np.asarray(order, dtype=np.float64))


def _named(base: str) -> str | None:
    return next((name for name, words in WORDS.items() if base.strip().lower() in words), None)


def _is_unit(text: str) -> bool:
    text = text.lower()
    return (
        text == ""
        or text.startswith(DECIBEL)
        or text in (*PHASES, *PLAIN)
        or frequency_unit(text) is not None
        or ratio_of(text) is not None
    )


def _unit_of_gain(path: Path, column: str, values: FloatArray) -> str:
    """A level is below 0 somewhere, or, if it is not, beyond 1: a ratio in SI units may be either."""
    known = values[np.isfinite(values)]
    if (known < 0.0).any():
        return DECIBEL
    if known.max(initial=0.0) < 1.0:
        return "abs"
    raise RecordError(
        f"{path}: {column}: is it a ratio or in dB? Its values, from {known.min():g} to {known.max():g}, may be "
        "either; name it magnitude or magnitude_db, or map it"
    )


def _unit_of_phase(path: Path, column: str, values: FloatArray) -> str:
    most = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    if most > 45.0:  # in radians it would be seven turns
        return "deg"
    if most <= 1.001 * np.pi:
        return "rad"
    raise RecordError(
        f"{path}: {column}: is it in degrees or radians? Its values, up to {most:g}, may be either; name it phase_deg "
        "or phase_rad, or map it"
    )


def _si(
    path: Path, column: str, text: str, hz: FloatArray, outputs: Sequence[str]
) -> tuple[ComplexArray, list[Finding]]:
    """Factors that make SI units of the outputs, such as m/A or A/A, of a unit such as ``um/A`` or ``g/A``."""
    found, findings = ratio_of(text), []
    orders: dict[str, int] = {}
    for output in dict.fromkeys(outputs):
        own = Channel.of(output)
        unit = "m" if own is None else own.signal.unit
        wanted = unit_of(unit)
        kinds = INTEGRATIONS if wanted is None or wanted.kind in INTEGRATIONS else (wanted.kind,)
        if found is None or wanted is None or found[0].kind not in kinds:
            example = {
                **{"m": "m/A, mm/A, um/A or mil/A, mm/s/A or in/s/A, m/s^2/A or g/A", "m/s^2": "m/s^2/A or g/A"},
                **{"A": "A/A or mA/A", "V": "V/A or mV/A"},
            }.get(unit, f"or none for {unit}/A")
            raise RecordError(f"{path}: {column}: the unit {text!r} is none of {output}; expected dB, {example}")
        orders[output] = INTEGRATIONS.get(found[0].kind, 0) - INTEGRATIONS.get(wanted.kind, 0)
        if orders[output]:
            findings.append(UNITS_CONVERTED(channels=[output], found=f"{found[0].kind} in {text}", unit=unit))
    upper, lower = found or (Unit("displacement", 1.0), None)
    factor = upper.factor / (1.0 if lower is None else lower.factor)
    return factor * integrated(hz, np.array([orders[output] for output in outputs])), findings
