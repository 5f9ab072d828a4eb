"""How far a loop is from instability: its poles and the peaks of its sensitivity, and the uncertain model itself."""

from ambid.robustness.eigenvalues import PoleMap, pole_map
from ambid.robustness.procedure import margins, sensitivity_peaks
from ambid.robustness.result import ZONES, AxisMargins, Margin, Margins, zone_of
from ambid.robustness.uncertain_model import UncertainModel, uncertain
from ambid.robustness.whirl import Campbell, Whirl, campbell

__all__ = [
    "ZONES",
    "AxisMargins",
    "Campbell",
    "Margin",
    "Margins",
    "PoleMap",
    "UncertainModel",
    "Whirl",
    "campbell",
    "margins",
    "pole_map",
    "sensitivity_peaks",
    "uncertain",
    "zone_of",
]
