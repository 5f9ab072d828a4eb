"""The rig that is meant by a rig or the path of its file."""

from __future__ import annotations

from pathlib import Path

from ambid.errors import RigError
from ambid.rig.rig import Rig

__all__ = ["as_rig"]


def as_rig(given: Rig | str | Path) -> Rig:
    """The rig itself, or the one in a file.

    Raises
    ------
    RigError
        If it is neither, or the file is none.
    """
    if isinstance(given, Rig):
        return given
    if isinstance(given, str | Path):
        return Rig.load(given)
    raise RigError(f"rig: {type(given).__name__} given; expected a Rig, or the path of a rig file")
