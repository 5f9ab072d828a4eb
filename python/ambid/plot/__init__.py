"""Pictures: measured and simulated signals, and what a diagnosis found.

Every function draws on the axes that it is given, or on those of a new figure (``ax.figure``), and returns them; no
global state is touched. All are legible in black and white.
"""

from ambid.plot.campaign import campaign_files, plot_campaign, save_campaign
from ambid.plot.diagnosis import plot_prediction, plot_ranking, plot_staircase, save_prediction, save_ranking
from ambid.plot.misfit import plot_growth, plot_misfit_map, plot_misfit_matrix, plot_needed
from ambid.plot.responses import draw_responses, plot_frequency_response, save_responses
from ambid.plot.robustness import (
    plot_campbell,
    plot_poles,
    plot_sensitivity,
    save_campbell,
    save_poles,
    save_sensitivity,
)
from ambid.plot.signals import picture_files, plot_comparison, plot_record, save_comparison, worst_stretch
from ambid.plot.style import check_format, save_figure

__all__ = [
    "campaign_files",
    "check_format",
    "draw_responses",
    "picture_files",
    "plot_campaign",
    "plot_campbell",
    "plot_comparison",
    "plot_frequency_response",
    "plot_growth",
    "plot_misfit_map",
    "plot_misfit_matrix",
    "plot_needed",
    "plot_poles",
    "plot_prediction",
    "plot_ranking",
    "plot_record",
    "plot_sensitivity",
    "plot_staircase",
    "save_campaign",
    "save_campbell",
    "save_comparison",
    "save_figure",
    "save_poles",
    "save_prediction",
    "save_ranking",
    "save_sensitivity",
    "save_responses",
    "worst_stretch",
]
