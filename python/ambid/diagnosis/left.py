"""Whether what named effects leave has a shape of its own: then they stand in for something that has no name.

Linear effects can take the place of friction, of a dead band or of a stop at one amplitude, and leave little more than
noise in all. The signal that a port would still need has the shape of what is missing, and a score for one shape sees
less than the sum over all lines does.
"""

from __future__ import annotations

from ambid.diagnosis.state import State
from ambid.noise.unseen import ShapeLeft, shape_left

__all__ = ["shape_of"]

OF_FORMULAS = 0.05
"""Part of what effects explain of records without periods that their formulas may leave as a shape: what stood in for
friction and dead bands left 17 to 60 % of that, the coil of a levitator that was bought 0.6 to 1.7 %."""


def shape_of(state: State) -> ShapeLeft | None:
    """The nonlinear shape that the last model leaves of a record; None where none is sure."""
    fit = state.fit
    for part in fit.noise.in_time:
        own = 0.0 if part.noise_is_measured else OF_FORMULAS * state.fall
        if shape := shape_left(part, fit.model, least=max(own, state.of_formulas)):
            return shape
    return None
