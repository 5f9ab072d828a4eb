"""What objects of python-control and SciPy hold, as a controller of the rig takes it."""

from typing import Any

import numpy as np

from ambid.errors import RigError

__all__ = ["as_state_space", "per_axis_polynomials"]


def as_state_space(system: Any) -> Any:
    """What the object itself makes of it; RigError where that is no state space, as of a frequency response."""
    try:
        return system.to_ss()
    except Exception as error:  # of another package: it may be any
        is_response = hasattr(system, "omega") or "frequency" in type(system).__name__.lower()
        what = (
            "a frequency response is no model of a controller, whose states are needed" if is_response else str(error)
        )
        raise RigError(
            f"controller: {type(system).__name__} object: {what}; expected a linear system with A, B, C, D or num, "
            "den: give the law itself, or fit one to the response first."
        ) from None


def per_axis_polynomials(rows: Any, may_couple: bool) -> list[list[float]]:
    """Polynomial of each axis, from SciPy's single one or python-control's outputs x inputs of them."""
    if np.isscalar(rows[0]):
        return [list(map(float, rows))]
    if np.isscalar(rows[0][0]):  # SciPy with one input, a row per output
        rows = [[row] for row in rows]
    coupled = not may_couple and any(np.any(p) for i, row in enumerate(rows) for j, p in enumerate(row) if i != j)
    if len(rows) != len(rows[0]) or coupled:
        raise RigError(
            f"controller: {len(rows)} x {len(rows[0])} transfer functions: expected a diagonal matrix, one per axis; "
            "convert coupled ones to state space first (control.ss)."
        )
    return [list(map(float, rows[k][k])) for k in range(len(rows))]
