"""Units as instruments write them, and the factors that make SI units of them."""

import re
from dataclasses import dataclass

import numpy as np
from scipy.constants import foot, g, inch

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
    **dict.fromkeys(("rpm", "1/min", "r/min", "cpm", "rev/min"), 1.0 / 60.0),
}


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


def unit_of(text: str) -> Unit | None:
    """The unit that a text names, such as ``mm/s`` or ``µm``; None for an unknown one."""
    found = _UNITS.get(_plain(text))
    return None if found is None else Unit(*found)


def ratio_of(text: str) -> tuple[Unit, Unit | None] | None:
    """Units of a response, such as ``um/A``, and of its excitation if that is named; None for unknown ones."""
    whole = unit_of(text)
    if whole is not None:
        return whole, None
    above, slash, below = _plain(text).rpartition("/")
    upper, lower = unit_of(above), unit_of(below)
    return (upper, lower) if slash and upper is not None and lower is not None else None


def frequency_unit(text: str) -> float | None:
    """Factor that makes Hz of a unit of frequency or speed, such as ``rad/s`` or ``rpm``; None for an unknown one."""
    return _FREQUENCIES.get(_plain(text))


def _plain(text: str) -> str:
    """Small letters without blanks, powers and brackets, so that one way of writing is left of many."""
    own = re.sub(r"[\s()\[\]^]|\*\*", "", text.lower()).replace("²", "2")
    return own.replace("µ", "u").replace("μ", "u").replace("·", "*")
