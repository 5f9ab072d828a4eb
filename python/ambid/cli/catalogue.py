"""The command `effects`: what a diagnosis may add to a model."""

from __future__ import annotations

from inspect import signature
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

import ambid
from ambid.cli.options import JsonFile, Quiet, known_effects
from ambid.cli.outputs import conclude, require_outputs
from ambid.cli.signals import stoppable
from ambid.results import of_unit, speed_text


def effects_command(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="One effect; default: all.", autocompletion=known_effects)
    ] = None,
    rig: Annotated[Path | None, typer.Option(metavar="RIG", help="Ranges on this rig; default: the demo's.")] = None,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """List the catalogue: physics, equation, parameters with what is allowed, signature in the residual, source."""
    require_outputs({"--rig": rig}, {"--json": json_file})
    chosen = ambid.CATALOGUE if name is None else (ambid.effects.find(name),)
    machine = ambid.Rig.load(ambid.demo.DATA / "rig.toml" if rig is None else rig)
    if rig is None:  # at rest not every effect would have its parameters
        machine = machine.replace(speed=200.0)
    with stoppable():
        entries = [_entry(effect, machine) for effect in chosen]
    head = f"parameters and their ranges on {machine.name!r} at {speed_text(machine.speed)}"
    data = {"rig": machine.name, "speed": machine.speed, "effects": entries}
    conclude("\n\n".join([*map(_text, entries), head]), data, json_file, quiet)


def _entry(effect: ambid.Effect, rig: ambid.Rig) -> dict[str, Any]:
    """Plain data of an effect; null where a range has no end."""
    own = effect.parameters(rig)
    constants = signature(type(effect)).parameters.values()
    return {
        "name": effect.name,
        "physics": effect.physics,
        "equation": effect.equation,
        "parameters": [
            {
                "name": p.name,
                "meaning": p.meaning,
                "unit": p.unit,
                "lower": p.lower if isfinite(p.lower) else None,
                "upper": p.upper if isfinite(p.upper) else None,
                "typical": p.probe,
            }
            for p in own
        ],
        "not_on_this_rig": effect.why_not(rig),
        "settings": {c.name: c.default for c in constants if c.name not in {p.name for p in own}},
        "signature": effect.signature,
        "source": effect.source,
    }


def _text(entry: dict[str, Any]) -> str:
    lines = [f"{entry['name']}: {entry['physics']}"]
    if entry["equation"]:
        lines.append(f"    {entry['equation']}")
    for p in entry["parameters"]:
        low, high = ("any" if end is None else f"{end:g}" for end in (p["lower"], p["upper"]))
        span = f"{low:>8s} .. {high:8s} {of_unit(p['unit']).strip():8s} typical {p['typical']:<8g}"
        lines.append(f"    {p['name']:20s} {span} {p['meaning']}".rstrip())
    if entry["not_on_this_rig"]:
        lines.append(f"    makes no sense on this rig: {entry['not_on_this_rig']}")
    if entry["settings"]:
        lines.append(f"    settings: {', '.join(f'{name} = {value}' for name, value in entry['settings'].items())}")
    return "\n".join([*lines, f"    shows as: {entry['signature']}", f"    source: {entry['source']}"])
