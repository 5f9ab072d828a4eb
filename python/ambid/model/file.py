"""Models as files: JSON with the rig, the effects, the parameters, and their covariance."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from ambid.arrays import FloatArray
from ambid.channels import SIGNALS
from ambid.effects import Effect, find
from ambid.effects.instruments import instruments_among
from ambid.effects.known import KNOWN
from ambid.errors import ModelError
from ambid.model.parameter import Parameter
from ambid.model.structure import Structure
from ambid.reading import reading
from ambid.rig import Rig
from ambid.writing import whole_file

FORMAT = "ambid model 1"
LONGEST_FILE = 1 << 25
"""Characters of a model file: those of its rigs, and the covariance of a thousand parameters."""
ROUNDING = 1e-9
"""Part of a variance by which an eigenvalue of a covariance may be negative."""


def write_model(
    path: Path, structure: Structure, parameters: Sequence[Parameter], covariance: ArrayLike | None
) -> None:
    """Write a model with its further operating points; the covariance has NaN for parameters that were not free."""
    matrix = None
    if covariance is not None:
        matrix = [[float(c) if np.isfinite(c) else None for c in row] for row in np.asarray(covariance)]
    text = {
        "format": FORMAT,
        "rig": structure.rig.to_toml(),
        "points": [point.to_toml() for point in structure.points],
        "effects": [{"name": effect.name, **effect.settings()} for effect in structure.effects],
        "parameters": {p.name: {"value": p.value, "unit": p.unit, "slots": list(p.slots)} for p in parameters},
        "tolerances": bool(structure.known),
        "covariance": matrix,
    }
    with whole_file(path) as stream:
        stream.write(json.dumps(text, indent=1).encode())


def read_model(
    path: Path, rig: Rig | None, catalogue: Sequence[Effect]
) -> tuple[Structure, list[Parameter], FloatArray | None]:
    """Read what `write_model` wrote; the covariance is None where the file has none.

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
    with reading(path, ModelError, "a model", "give the file of a saved model"):
        return _model_of(path, _content(path), rig, catalogue)


def rigs_of_model(path: Path) -> list[Rig]:
    """The rig that a model was saved of, and those of its further operating points.

    Raises
    ------
    ModelError
        If the file is none of ours or has been broken.
    """
    with reading(path, ModelError, "a model", "give the file of a saved model"):
        text = _content(path)
        return [Rig.from_toml(own, path) for own in (text["rig"], *text.get("points", ()))]


def _content(path: Path) -> dict[str, Any]:
    with path.open(encoding="utf-8") as file:
        content = file.read(LONGEST_FILE + 1)
    if len(content) > LONGEST_FILE:
        raise ModelError(f"{path}: more than {LONGEST_FILE} characters; give the file of a saved model")
    text: dict[str, Any] = json.loads(content)
    return text


def _model_of(
    path: Path, text: dict[str, Any], rig: Rig | None, catalogue: Sequence[Effect]
) -> tuple[Structure, list[Parameter], FloatArray | None]:
    if text.get("format") != FORMAT:
        raise ModelError(f"{path}: format = {text.get('format')!r}, expected {FORMAT!r}, as saved models have it")
    stored = [_parameter(path, name, entry) for name, entry in text["parameters"].items()]
    covariance = _covariance(text.get("covariance"))
    effects = [(entry["name"], {k: v for k, v in entry.items() if k != "name"}) for entry in text["effects"]]
    points = tuple(Rig.from_toml(point, path) for point in text.get("points", ()))
    machine = Rig.from_toml(text["rig"], path) if rig is None else rig
    unknown = {name for name, _ in effects} - {effect.name for effect in catalogue}
    if unknown:
        raise ModelError(
            f"{path}: {', '.join(sorted(unknown))}: no such effect in the catalogue; a model with effects of your own "
            "is loaded by Model.load(..., catalogue=(*CATALOGUE, own))"
        )
    try:
        found = tuple(find(name, settings, catalogue) for name, settings in effects)
        known = (*KNOWN, *instruments_among(text["parameters"], machine))
        known = tuple(effect for effect in known if text.get("tolerances") and not effect.why_not(machine))
        structure = Structure(machine, found, points, machine, known=known)
        if covariance is not None:
            _require_covariance(covariance, len(stored))
        stored, covariance = _known_here(stored, covariance, structure.usual_parameters())
        parameters = _with_limits(stored, structure.usual_parameters())
        structure.require_filled(parameters)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    return structure, parameters, covariance


def _parameter(path: Path, name: str, entry: Mapping[str, Any]) -> Parameter:
    value, unit, slots = entry["value"], entry["unit"], entry["slots"]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ModelError(f"{path}: {name}: value = {value!r}: expected a number")
    if not isinstance(unit, str) or not isinstance(slots, list) or not all(isinstance(slot, str) for slot in slots):
        raise ModelError(f"{path}: {name}: unit = {unit!r}, slots = {slots!r}: expected a text, and a list of texts")
    return Parameter(name, float(value), unit, tuple(slots))


def _covariance(rows: Any) -> FloatArray | None:
    if rows is None:
        return None
    return np.array([[np.nan if entry is None else entry for entry in row] for row in rows], dtype=np.float64)


def _require_covariance(matrix: FloatArray, count: int) -> None:
    """Refuse what is no covariance of as many parameters; one that was not free has NaN with all others.

    Raises
    ------
    ModelError
    """
    if matrix.shape != (count, count):
        raise ModelError(f"covariance has the shape {matrix.shape}: expected {(count, count)}, a row a parameter")
    free = np.isfinite(np.diag(matrix))
    known = matrix[np.ix_(free, free)]
    scale = np.sqrt(np.abs(np.diag(known)))
    scale[scale == 0.0] = 1.0
    scaled = known / scale / scale[:, None]
    if not np.array_equal(np.isfinite(matrix), np.outer(free, free)) or not np.allclose(scaled, scaled.T, 0, ROUNDING):
        raise ModelError("covariance is not symmetric, or not finite where its diagonal is; identify again")
    if known.size and np.linalg.eigvalsh(scaled).min() < -ROUNDING:
        raise ModelError("covariance gives a sum of parameters a negative variance; identify again")


def errors_of_model(path: Path) -> dict[str, float]:
    """Errors of values of the rig file that are not 0 in a saved model, by name.

    Raises
    ------
    ModelError
        If the file is none of ours or has been broken.
    """
    with reading(path, ModelError, "a model", "give the file of a saved model"):
        entries = {name: entry["value"] for name, entry in _content(path)["parameters"].items()}
        return {name: value for name, value in entries.items() if _is_error(name) and value != 0.0}


def _is_error(name: str) -> bool:
    """Whether a parameter is the error of a value of the rig file."""
    keys = {effect.name for effect in KNOWN} | {own.gain for own in SIGNALS.values() if own.gain}
    return name.partition(".")[0] in keys


def _known_here(
    stored: list[Parameter], covariance: FloatArray | None, usual: Sequence[Parameter]
) -> tuple[list[Parameter], FloatArray | None]:
    """What was stored without errors of values that are exact on this rig, and with those of values that only it knows.

    The latter are 0, as well known as the rig says, and independent of the rest.
    """
    names = {p.name for p in usual}
    kept = [i for i, p in enumerate(stored) if p.name in names or not _is_error(p.name)]
    there = {p.name for p in stored}
    more = [p for p in usual if p.prior is not None and p.name not in there]
    if covariance is not None:
        covariance = block_diag(covariance[np.ix_(kept, kept)], np.diag([float(p.prior or 0.0) ** 2 for p in more]))
        fixed = np.isnan(np.diag(covariance))
        covariance[fixed] = covariance[:, fixed] = np.nan
    return [*(stored[i] for i in kept), *more], covariance


def _with_limits(stored: Sequence[Parameter], usual: Sequence[Parameter]) -> list[Parameter]:
    """The stored values, with what physics allows of each."""
    filling = {slot: p for p in usual for slot in p.slots}
    alike = [next((filling[slot] for slot in p.slots if slot in filling), p) for p in stored]
    return [replace(own, name=p.name, value=p.value, slots=p.slots) for own, p in zip(alike, stored, strict=True)]
