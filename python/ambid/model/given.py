"""The model that is meant by a model, a rig, or the path of the file of either."""

from pathlib import Path

from ambid.errors import ModelError
from ambid.model.model import Model
from ambid.rig import Rig, as_rig

Given = Model | Rig | str | Path
"""A model or a rig, or the path of a rig file or of a saved model."""


def as_model(given: Given) -> Model:
    """The model itself, the base model of a rig, or the one in a file; ``.json`` is what `Model.save` wrote.

    Raises
    ------
    InputError
        If it is nothing of these, or the file is none.
    """
    if isinstance(given, Model):
        return given
    if isinstance(given, str | Path) and Path(given).suffix.lower() == ".json":
        return Model.load(given)
    if isinstance(given, Rig | str | Path):
        return Model(as_rig(given))
    raise ModelError(
        f"model: {type(given).__name__} given; expected a Model, a Rig, or the path of a rig file or of a saved model"
    )
