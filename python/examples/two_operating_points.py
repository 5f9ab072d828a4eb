"""Fit and diagnose records of two operating points together: what neither can determine alone.

The machine is simulated here; of yours, each record is loaded with the rig file of its day, and `record.at(that_rig)`
says that it belongs to another operating point. From the shell, name the second rig file before its records.
"""

import ambid
from ambid.demo import DATA

rig = ambid.Rig.load(DATA / "rig.toml")  # at rest
fast = rig.replace(name="at 600 rad/s", speed=600.0)
bearings = tuple(b.model_copy(update={"bias_current": 1.2 * b.bias_current}) for b in rig.bearings)
higher = rig.replace(name="higher bias", bearings=bearings)

# What we pretend not to know: the disks are 30 % heavier about the axis than the drawing says.
i_e = ambid.prbs(8, amplitude=1.0, hold=4, axes=4, periods=4)
machine = ambid.Model(fast).add("gyroscopic_coupling", {"factor": 0.3})
at_rest = ambid.Model(rig).virtual_experiment(i_e, seed=1)
at_speed = machine.virtual_experiment(i_e, seed=2).at(fast)

alone = ambid.diagnose(rig, at_rest)
print(f"at rest alone: {alone.verdict}")
both = ambid.diagnose(rig, [at_rest, at_speed])
factor = next(p.value for p in both.model.parameters if p.name == "gyroscopic_coupling.factor")
print(f"with a record at speed: {both.verdict} by {', '.join(both.effects)}, factor {factor:.2f}")
for record in ambid.compare(both.model, [at_rest, at_speed]).records:
    print(f"  {record.record.name}: misfit {record.misfit:.2f}")

# Every bias current has K_i and K_s of its own; tau_e and all effects are shared.
strong = ambid.Model(higher).virtual_experiment(0.5 * i_e, seed=3).at(higher)
joint = ambid.identify(rig, [at_rest, strong])
for name in ("K_i.A_zeta", next(name for name in joint.parameters if name.startswith("K_i.A_zeta@")), "tau_e"):
    p = joint.parameters[name]
    print(f"{name}: {p.value:.6g} +- {p.std_error:.2g} {p.unit}")
