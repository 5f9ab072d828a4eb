"""The line of current over force of a static loading, and what its interval rests on."""

from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from ambid.arrays import FloatArray
from ambid.identification.estimate import ParameterEstimate
from ambid.identification.load_dependence import IntArray, centred

__all__ = ["Line", "fit_by_flux", "fit_line"]


class Line(NamedTuple):
    """Line i_c = slope f + a constant of each loading, with what its interval rests on."""

    slope: float  # 1/K_i [A/N]
    std_error: float
    freedom: float
    residual: FloatArray  # [A]
    by_loading: FloatArray  # slope of each loading that loads the axis
    clustered: bool  # whether the interval rests on the scatter between loadings

    @property
    def half_width(self) -> float:
        """Of the 95 % interval of the slope."""
        return float(stdtrit(self.freedom, 0.975)) * self.std_error

    def k_i(self) -> ParameterEstimate:
        """K_i with its interval, which is that of the slope inverted."""
        ci95 = (1.0 / (self.slope + self.half_width), 1.0 / (self.slope - self.half_width))
        return ParameterEstimate(1.0 / self.slope, self.std_error / self.slope**2, ci95, "N/A")


def fit_line(force: FloatArray, current: FloatArray, of: IntArray) -> Line:
    """The line of an axis by least squares, with an interval by its loadings or, of few, by its steps."""
    f, i = centred(force, of), centred(current, of)
    total = f @ f
    slope = f @ i / total
    residual = i - slope * f
    share = np.bincount(of, f * f) / total
    loaded = share > 1e-6
    by_loading = np.bincount(of, f * i)[loaded] / (share[loaded] * total)
    concentration = float(share @ share)  # 1/L for L equal loadings
    clustered = 1.0 / concentration >= 2.5  # effective number of loadings from which their scatter gives the intervals
    if clustered:
        variance = float(share[loaded] @ (by_loading - slope) ** 2 * concentration / (1.0 - concentration))
        freedom = 1.0 / concentration - 1.0
    else:
        leverage = 1.0 / np.bincount(of)[of] + f * f / total
        alone = leverage.max() > 0.999  # above it one step alone decides the slope
        variance = np.inf if alone else float(f**2 @ (residual / (1.0 - leverage)) ** 2 / total**2)
        freedom = len(f) - len(share) - 1.0
    return Line(float(slope), float(np.sqrt(variance)), freedom, residual, by_loading, clustered)


def fit_by_flux(flux: FloatArray, load: FloatArray, current: FloatArray, of: IntArray) -> Line:
    """The same line by the force that the flux makes, with that of the load as instrument: both may have noise."""
    by_load, share = fit_line(load, current, of), fit_line(load, flux, of).slope
    slope = by_load.slope / share
    left = fit_line(load, current - slope * flux, of)
    return left._replace(slope=slope, std_error=left.std_error / abs(share), by_loading=slope + left.by_loading / share)
