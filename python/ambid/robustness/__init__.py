"""How far a loop is from instability: peaks of its sensitivity under uncertainty, and the uncertain model itself."""

from ambid.robustness.procedure import margins, sensitivity_peaks
from ambid.robustness.result import ZONES, AxisMargins, Margin, Margins, zone_of
from ambid.robustness.uncertain_model import UncertainModel, uncertain

__all__ = [
    "ZONES",
    "AxisMargins",
    "Margin",
    "Margins",
    "UncertainModel",
    "margins",
    "sensitivity_peaks",
    "uncertain",
    "zone_of",
]
