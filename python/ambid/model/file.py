"""Models as files: JSON with the rig, the effects, the parameters, and their covariance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambid.effects import Effect, find
from ambid.errors import ModelError
from ambid.model.parameter import Parameter
from ambid.model.structure import Structure
from ambid.rig import Rig
from ambid.writing import whole_file

__all__ = ["read_model", "write_model"]

FORMAT = "ambid model 1"


def write_model(
    path: Path, structure: Structure, parameters: Sequence[Parameter], covariance: ArrayLike | None
) -> None:
    """Write a model with its further operating points; the covariance has NaN for parameters that were not free."""
    matrix = None
    if covariance is not None:
        matrix = [[None if np.isnan(c) else float(c) for c in row] for row in np.asarray(covariance)]
    text = {
        "format": FORMAT,
        "rig": structure.rig.to_toml(),
        "points": [point.to_toml() for point in structure.points],
        "effects": [{"name": effect.name, **effect.settings()} for effect in structure.effects],
        "parameters": {p.name: {"value": p.value, "unit": p.unit, "slots": list(p.slots)} for p in parameters},
        "covariance": matrix,
    }
    with whole_file(path) as stream:
        stream.write(json.dumps(text, indent=1).encode())


def read_model(path: Path, rig: Rig | None, catalogue: Sequence[Effect]) -> tuple[Structure, list[Parameter]]:
    """Read what `write_model` wrote.

    Parameters
    ----------
    path : Path
    rig : Rig, optional
        Taken in place of the stored one.
    catalogue : sequence of Effect
        Where the effects are found by name.

    Raises
    ------
    ModelError
        If the file is none of ours or has been broken, or an effect of it is not in the catalogue.
    """
    try:
        text: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if text.get("format") != FORMAT:
            raise ModelError(f"{path}: format = {text.get('format')!r}, expected {FORMAT!r}, as --save writes it")
        stored = [
            Parameter(name, float(p["value"]), p["unit"], tuple(p["slots"])) for name, p in text["parameters"].items()
        ]
        effects = [(entry["name"], {k: v for k, v in entry.items() if k != "name"}) for entry in text["effects"]]
        points = tuple(Rig.from_toml(point, path) for point in text.get("points", ()))
        machine = Rig.from_toml(text["rig"], path) if rig is None else rig
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error.strerror}); give a file that --save wrote") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{path}: not a model that --save wrote ({type(error).__name__}: {error})") from None
    unknown = {name for name, _ in effects} - {effect.name for effect in catalogue}
    if unknown:
        raise ModelError(
            f"{path}: {', '.join(sorted(unknown))}: no such effect in the catalogue; a model with effects of your own "
            "is loaded by Model.load(..., catalogue=(*CATALOGUE, own))"
        )
    try:
        found = tuple(find(name, settings, catalogue) for name, settings in effects)
        structure = Structure(machine, found, points, machine)
        parameters = _with_limits(stored, structure.usual_parameters())
        structure.require_filled(parameters)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    return structure, parameters


def _with_limits(stored: Sequence[Parameter], usual: Sequence[Parameter]) -> list[Parameter]:
    """The stored values, with what physics allows of each."""
    filling = {slot: p for p in usual for slot in p.slots}
    alike = [next((filling[slot] for slot in p.slots if slot in filling), p) for p in stored]
    return [replace(own, name=p.name, value=p.value, slots=p.slots) for own, p in zip(alike, stored, strict=True)]
