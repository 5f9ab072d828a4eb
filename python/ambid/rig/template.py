"""Commented rig files to begin from, one a kind of machine."""

from __future__ import annotations

from pathlib import Path

from ambid.errors import RigError, did_you_mean

TEMPLATES = Path(__file__).with_name("templates")
KINDS = {
    "pid": "a shaft of finite elements in two bearings, with a PID controller",
    "state_space": "the same with a controller given by its matrices",
    "levitator": "a mass on one axis",
    "modal_rotor": "a rotor given by its modes",
}
"""What `rig_template` has."""


def rig_template(kind: str) -> str:
    """Text of a commented rig file that loads and makes a stable loop.

    Parameters
    ----------
    kind : str
        One of `KINDS`.

    Raises
    ------
    RigError
        If there is no such kind.
    """
    if kind not in KINDS:
        raise RigError(f"{kind}: no such kind of rig file; {did_you_mean(kind, KINDS)}expected {', '.join(KINDS)}")
    return (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
