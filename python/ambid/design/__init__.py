"""Which experiment to make: what an excitation does, what a record of it would tell, and the best one within limits."""

from ambid.design.best import Design, design
from ambid.design.forecast import Forecast, Limits, forecast
from ambid.design.playing import save_excitation
from ambid.design.prospect import Prospect, prospect
from ambid.design.separation import Proposal, Proposals, after, propose
from ambid.design.visible import Visibility, Visible, visible
from ambid.noise.foreseen import Instruments

__all__ = [
    "Design",
    "Forecast",
    "Instruments",
    "Limits",
    "Proposal",
    "Proposals",
    "Prospect",
    "Visibility",
    "Visible",
    "after",
    "design",
    "forecast",
    "propose",
    "prospect",
    "save_excitation",
    "visible",
]
