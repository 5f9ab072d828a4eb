"""Whether what named effects leave has a shape of its own: then they stand in for something that has no name.

Linear effects can take the place of friction, of a dead band or of a stop at one amplitude, and leave little more than
noise in all. The signal that a port would still need has the shape of what is missing, and a score for one shape sees
less than the sum over all lines does.
"""

from __future__ import annotations

from ambid.diagnosis.state import State
from ambid.noise.unseen import shape_left

__all__ = ["shape_of"]


def shape_of(state: State) -> str:
    """The nonlinear shape that the last model leaves of a record, in words; empty where none is sure."""
    fit = state.fit
    found = (shape_left(part, fit.model, least=state.of_formulas) for part in fit.noise.in_time)
    return next((shape for shape in found if shape), "")
