"""The rotor: a beam model of the shaft, or the user's own matrices or modes, reduced to the modes that are kept."""

from ambid.rotor.assembly import BeamModel, assemble, matrix_model
from ambid.rotor.modes import ReducedRotor, further_modes, reduce, reduced_rotor, with_more_modes

__all__ = [
    "BeamModel",
    "ReducedRotor",
    "assemble",
    "further_modes",
    "matrix_model",
    "reduce",
    "reduced_rotor",
    "with_more_modes",
]
