"""Noise of the records, and the misfit in units of it: J/dof, which is 1 when the model is right."""

from ambid.noise.adequacy import Adequacy, Criterion
from ambid.noise.ceiling import noise_ceiling
from ambid.noise.comparison import Comparison, compare
from ambid.noise.noise import Noise, Quadratic
from ambid.noise.responses import Responses, frequency_responses

__all__ = [
    "Adequacy",
    "Comparison",
    "Criterion",
    "Noise",
    "Quadratic",
    "Responses",
    "compare",
    "frequency_responses",
    "noise_ceiling",
]
