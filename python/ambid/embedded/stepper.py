"""The file that the stepper in C reads."""

from __future__ import annotations

from pathlib import Path

from ambid.model import Model
from ambid.writing import whole_file

__all__ = ["to_stepper"]


def to_stepper(model: Model, path: str | Path) -> None:
    """Write the closed loop for the stepper in C, which needs no Python: see ``ambid.h``.

    It steps as `Model.simulator` does, to rounding, nonlinear effects too; SI units, inputs and outputs in the order of
    ``model.loop.inputs`` and ``model.loop.outputs``.

    Parameters
    ----------
    model : Model
        At its own rig's operating point.
    path : str or Path

    Raises
    ------
    ModelError
        If the loop is too large to be stepped: more than 1024 states, commands under way among them.
    """
    content = packed(model)
    with whole_file(path) as stream:
        stream.write(content)


def packed(model: Model) -> bytes:
    """The content of the file; for its layout see ``rust/core/src/packed.rs``."""
    return model.loop.packed(model.theta, model.names)
