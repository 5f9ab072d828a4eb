"""What a person should know of rig files: what is unusual or taken over in part, and how two differ."""

from collections.abc import Iterator
from typing import Any

from ambid.findings import Finding, Kind, Where
from ambid.rig.fields import plain, shortened
from ambid.rig.rig import Rig
from ambid.rig.rotor import MatrixRotor

MAGNETS_CENTRE = Kind(
    "magnets_centre",
    "note",
    "K_s = {k_s:.4g} N/m is negative: the magnet centres the rotor, as passive and repelling ones do",
    "an attracting magnet has K_s > 0 (f = K_i i + K_s s): correct the sign if it is one",
)
MISSING = "nothing"


def notes_of(rig: Rig) -> Iterator[Finding]:
    """Magnets that centre the rotor, and what a rotor of another program has lost."""
    for bearing in rig.bearings:
        for axis, k_s in zip(bearing.axis_names, bearing.force_displacement, strict=True):
            if k_s < 0.0:
                yield MAGNETS_CENTRE(Where(key=f"bearing.{bearing.name}", axis=axis), k_s=k_s)
    if isinstance(rig.rotor, MatrixRotor):
        yield from rig.rotor.findings


def differences(one: Rig, other: Rig) -> list[tuple[str, str, str]]:
    """Keys of the rig file in which two rigs differ, each with the value of either as text.

    Their names and tolerances do not count: they change nothing of what a model of the rig does.

    Parameters
    ----------
    one, other : Rig

    Returns
    -------
    list of (str, str, str)
        Such as ``("bearing[0] (A).bias_current", "10", "6")``, in the order of the file.
    """
    beside = {"name", "tolerance"}
    first, second = (rig.model_dump(by_alias=True, exclude_none=True, exclude=beside) for rig in (one, other))
    return list(_apart("", first, second))


def _apart(key: str, one: Any, other: Any) -> Iterator[tuple[str, str, str]]:
    if isinstance(one, dict) and isinstance(other, dict):
        if one.get("kind") != other.get("kind"):
            yield f"{key}.kind", _text(one.get("kind")), _text(other.get("kind"))
            return
        for name in dict.fromkeys([*one, *other]):
            inner = f"{key}.{name}" if key else name
            yield from _apart(inner, one.get(name), other.get(name))
    elif _is_tables(one) and _is_tables(other):
        if len(one) != len(other):
            yield f"[[{key}]]", f"{len(one)} tables", f"{len(other)} tables"
            return
        for k, (own, theirs) in enumerate(zip(one, other, strict=True)):
            name = f" ({own['name']})" if "name" in own else ""
            yield from _apart(f"{key}[{k}]{name}", own, theirs)
    elif one != other:
        yield key, _text(one), _text(other)


def _is_tables(value: Any) -> bool:
    return isinstance(value, tuple) and bool(value) and all(isinstance(own, dict) for own in value)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return plain(value) if float(plain(value)) == value else repr(value)
    if isinstance(value, tuple) and all(isinstance(own, float) for own in value):
        text = f"[{', '.join(_text(own) for own in value)}]"
    else:
        text = MISSING if value is None else "a table" if isinstance(value, dict) else repr(value)
    return shortened(text, 40)
