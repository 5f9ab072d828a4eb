"""Models as files: JSON with the rig, the effects, the parameters, and their covariance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ambid.effects import Effect
from ambid.errors import ModelError
from ambid.model.parameter import Parameter
from ambid.rig import Rig

__all__ = ["read_model", "write_model"]

FORMAT = "ambid model 1"


class StoredModel(NamedTuple):
    """What a file holds: effects by name and settings, parameters without the limits of physics."""

    rig: Rig
    effects: list[tuple[str, dict[str, Any]]]
    parameters: list[Parameter]
    points: list[Rig]


def write_model(
    path: Path,
    rig: Rig,
    effects: Sequence[Effect],
    parameters: Sequence[Parameter],
    covariance: ArrayLike | None,
    points: Sequence[Rig] = (),
) -> None:
    """Write a model with its further operating points; the covariance has NaN for parameters that were not free."""
    matrix = None
    if covariance is not None:
        matrix = [[None if np.isnan(c) else float(c) for c in row] for row in np.asarray(covariance)]
    text = {
        "format": FORMAT,
        "rig": rig.to_toml(),
        "points": [point.to_toml() for point in points],
        "effects": [{"name": effect.name, **effect.settings()} for effect in effects],
        "parameters": {p.name: {"value": p.value, "unit": p.unit, "slots": list(p.slots)} for p in parameters},
        "covariance": matrix,
    }
    path.write_text(json.dumps(text, indent=1), encoding="utf-8")


def read_model(path: Path) -> StoredModel:
    """Read what `write_model` wrote.

    Raises
    ------
    ModelError
        If the file is none of ours or has been broken.
    """
    try:
        text: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if text.get("format") != FORMAT:
            raise ModelError(f"{path}: format = {text.get('format')!r}, expected {FORMAT!r}, as --save writes it")
        parameters = [
            Parameter(name, float(p["value"]), p["unit"], tuple(p["slots"])) for name, p in text["parameters"].items()
        ]
        effects = [(entry["name"], {k: v for k, v in entry.items() if k != "name"}) for entry in text["effects"]]
        points = [Rig.from_toml(point, path) for point in text.get("points", ())]
        return StoredModel(Rig.from_toml(text["rig"], path), effects, parameters, points)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error.strerror}); give a file that --save wrote") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{path}: not a model that --save wrote ({type(error).__name__}: {error})") from None
