"""Parameters from measurements: closed-loop identification, refits with added effects, static loading."""

from ambid.identification.closed_loop import identify
from ambid.identification.estimate import Estimate, ParameterEstimate
from ambid.identification.static_loads import StaticEstimate, static_load

__all__ = ["Estimate", "ParameterEstimate", "StaticEstimate", "identify", "static_load"]
