"""Which experiment to make: what an excitation does, what a record of it would tell, and the best one within limits."""

from ambid.design.forecast import Forecast, Limits, forecast
from ambid.design.playing import save_excitation

__all__ = ["Forecast", "Limits", "forecast", "save_excitation"]
