"""How accurate will an experiment be? Monte Carlo by hand: many virtual experiments, each identified."""

from dataclasses import replace

import numpy as np

import ambid
from ambid.demo import DATA

RUNS = 40

rig = ambid.Rig.load(DATA / "rig.toml")
machine = ambid.identify(rig, ambid.Record.load(DATA / "prbs.mat", rig)).model  # stands for the truth
truth = {p.name: p.value for p in machine.parameters}

# The experiment that is planned: its excitation, and the noise of its instruments.
excitation = ambid.prbs(8, amplitude=0.1, hold=4, axes=4, periods=4)
estimates = [
    ambid.identify(rig, replace(record, period=len(excitation) // 4))
    for record in (
        machine.virtual_experiment(excitation, sensor_noise=50e-9, current_noise=0.01, seed=seed)
        for seed in range(RUNS)
    )
]

print(f"{'parameter':12s} {'bias %':>8s} {'scatter %':>10s} {'stated %':>10s} {'inside 95 %':>12s}")
inside = 0
for name, true in truth.items():
    found = [estimate.parameters[name] for estimate in estimates]
    values = np.array([p.value for p in found])
    bias, scatter = 100.0 * (values.mean() / true - 1.0), 100.0 * values.std(ddof=1) / true
    stated = 100.0 * np.mean([p.std_error for p in found]) / true
    held = sum(p.ci95[0] <= true <= p.ci95[1] for p in found if p.ci95 is not None)
    inside += held
    print(f"{name:12s} {bias:8.3f} {scatter:10.3f} {stated:10.3f} {held:9d}/{RUNS}")
print(f"{100.0 * inside / (RUNS * len(truth)):.0f} % of the intervals held the truth")
