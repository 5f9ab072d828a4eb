"""What a person should know of a rig file that is right, but unusual, or taken over in part."""

from collections.abc import Iterator

from ambid.findings import Finding, Kind, Where
from ambid.rig.rig import Rig
from ambid.rig.rotor import MatrixRotor

__all__ = ["notes_of"]

MAGNETS_CENTRE = Kind(
    "magnets_centre",
    "note",
    "K_s = {k_s:.4g} N/m is negative: the magnet centres the rotor, as passive and repelling ones do",
    "an attracting magnet has K_s > 0 (f = K_i i + K_s s): correct the sign if it is one",
)


def notes_of(rig: Rig) -> Iterator[Finding]:
    """Magnets that centre the rotor, and what a rotor of another program has lost."""
    for bearing in rig.bearings:
        for axis, k_s in zip(bearing.axis_names, bearing.force_displacement, strict=True):
            if k_s < 0.0:
                yield MAGNETS_CENTRE(Where(key=f"bearing.{bearing.name}", axis=axis), k_s=k_s)
    if isinstance(rig.rotor, MatrixRotor):
        yield from rig.rotor.findings
