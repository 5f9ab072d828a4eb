"""Monte Carlo: many virtual experiments, each identified or diagnosed, and what their results are worth."""

from ambid.monte_carlo.executors import hold_plan
from ambid.monte_carlo.plan import Plan, Spread
from ambid.monte_carlo.procedure import run_monte_carlo
from ambid.monte_carlo.result import MonteCarlo

__all__ = ["MonteCarlo", "Plan", "Spread", "hold_plan", "run_monte_carlo"]
