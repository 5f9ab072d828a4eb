"""How accurate will an experiment be? Monte Carlo: many virtual experiments, each identified."""

import ambid
from ambid.demo import DATA

rig = ambid.Rig.load(DATA / "rig.toml")
machine = ambid.identify(rig, ambid.Record.load(DATA / "prbs.mat", rig)).model  # stands for the truth

# The experiment that is planned: its excitation, and the noise of its instruments.
plan = ambid.Plan(
    rig=rig,
    excitation=ambid.prbs(8, amplitude=0.1, hold=4, axes=4, periods=4),
    truth=machine,
    spreads=(ambid.Spread.parse("K_i=normal:2%"),),  # machines of a series differ
    sensor_noise=50e-9,
    current_noise=0.01,
)
found = ambid.run_monte_carlo(plan, 24)
print(found)

tau_e = found.parameters["tau_e"]
inside, spread = 100 * tau_e.coverage, 100 * tau_e.spread / tau_e.true
print(f"tau_e: {inside:.0f} % of the intervals held the truth, {spread:.2f} % spread")
