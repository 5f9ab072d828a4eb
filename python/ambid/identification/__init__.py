"""Parameters from measurements: closed-loop identification, refits with added effects, static loading, force laws."""

from ambid.identification.closed_loop import identify
from ambid.identification.common import with_common_tolerances
from ambid.identification.estimate import Estimate, ParameterEstimate
from ambid.identification.force_law import DIPOLES, SQUARE, ForceLaw, LawFit, StaticForce, fit_force_law
from ambid.identification.many import Estimates, identify_many
from ambid.identification.static_loads import StaticEstimate, static_load

__all__ = [
    "DIPOLES",
    "SQUARE",
    "Estimate",
    "Estimates",
    "ForceLaw",
    "LawFit",
    "ParameterEstimate",
    "StaticEstimate",
    "StaticForce",
    "fit_force_law",
    "identify",
    "identify_many",
    "static_load",
    "with_common_tolerances",
]
