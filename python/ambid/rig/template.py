"""Commented rig files to begin from, one a kind of machine."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

from ambid.errors import RigError, did_you_mean
from ambid.rig.tolerance import SOURCES, TYPICAL, UNITS

TEMPLATES = Path(__file__).with_name("templates")
KINDS = {
    "pid": "a shaft of finite elements in two bearings, with a PID controller",
    "state_space": "the same with a controller given by its matrices",
    "levitator": "a mass on one axis",
    "modal_rotor": "a rotor given by its modes",
}
"""What `rig_template` has."""


OF_SHAFTS = ("inertia", "position", "sensor_position", "sensor_angle", "bending_frequency", "modal_damping")
"""Keys of [tolerance] that a mass on one axis has no values for."""


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
    text = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
    return f"{text}\n{_tolerances(OF_SHAFTS if kind == 'levitator' else ())}"


def _tolerances(without: Sequence[str]) -> str:
    """The table of typical tolerances, each with where it is from."""
    lines = [
        "[tolerance]                    # how well the values are known: one standard deviation, here typical ones",
        "# exact = true                 # every value is exact, as in a simulation; then without the others",
    ]
    for key, value in TYPICAL.items():
        if key not in without:
            unit = UNITS.get(key, "relative")
            lines += wrap(SOURCES[key], 100, initial_indent="# ", subsequent_indent="# ")
            lines.append(f"{f'{key} = {value:g}':30s} # {unit}")
    return "\n".join(lines) + "\n"
