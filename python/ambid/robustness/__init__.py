"""How far a loop is from instability: peaks of its sensitivity under uncertainty, and the uncertain model itself."""

from ambid.robustness.procedure import margins
from ambid.robustness.result import ZONES, AxisMargins, Margin, Margins, zone_of

__all__ = ["ZONES", "AxisMargins", "Margin", "Margins", "margins", "zone_of"]
