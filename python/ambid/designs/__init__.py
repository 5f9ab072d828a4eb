"""Which experiment to make: what an excitation does, what a record of it would show, and the best one within limits."""

from ambid.designs.best import Design, design
from ambid.designs.intervals import Prospect, prospect
from ambid.designs.peaks import Forecast, Limits, forecast
from ambid.designs.playing import save_excitation
from ambid.designs.separation import Proposal, Proposals, next_experiments, tell_apart
from ambid.designs.sight import Visibility, Visible, visible
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
    "next_experiments",
    "design",
    "forecast",
    "tell_apart",
    "prospect",
    "save_excitation",
    "visible",
]
