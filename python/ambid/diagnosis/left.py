"""Whether what named effects leave has a shape of its own: then they stand in for something that has no name.

Linear effects can take the place of friction, of a dead band or of a stop at one amplitude, and leave little more than
noise in all. The signal that a port would still need has the shape of what is missing, and a score for one shape sees
less than the sum over all lines does.
"""

from __future__ import annotations

import numpy as np

from ambid.diagnosis.ports import needed_at_ports
from ambid.diagnosis.state import State
from ambid.errors import UnstableLoopError
from ambid.noise.lines import RecordLines

__all__ = ["shape_left"]

SHAPE_LEFT = 1e-5
"""Chance of the score of a shape that is no chance, over some twenty shapes: right models leave none below 1e-2."""


def shape_left(state: State) -> str:
    """The nonlinear shape that the last model leaves most surely, in words; empty where none is sure.

    Asked of records with periods, whose noise is measured: without, it is what is left, and may have any shape.
    """
    least, told = np.log(SHAPE_LEFT), ""
    for index, part in enumerate(state.fit.noise.parts):
        if not (isinstance(part, RecordLines) and part.noise_is_measured):
            continue
        try:
            ports = needed_at_ports(state.fit, index)
        except UnstableLoopError:  # a nonlinear model that is not stable at rest has no way back to a port
            continue
        for port in ports:
            for term in port.terms:
                if term.kind != "linear" and term.chance < least and term.score > state.of_formulas:
                    least, told = term.chance, f"a {port.name} that is {term.kind} and looks like {term.shape}"
    return told
