"""A controller designed with python-control: taken over, checked, and the closed loop handed back."""

import ambid
from ambid.demo import DATA

try:
    import control
except ImportError:
    raise SystemExit("this example needs python-control: pip install 'ambid[control]'") from None

rig = ambid.Rig.load(DATA / "rig.toml")

# From displacement [m] to current [A]; its sign as in i_ref = -(controller of y) + i_e. One for every axis.
s = control.tf("s")
pid = 28000.0 + 2.0e5 / s + 60.0 * s / (1e-4 * s + 1.0)
notch = (s**2 + 2 * 0.1 * 8700.0 * s + 8700.0**2) / (s**2 + 2 * 0.7 * 8700.0 * s + 8700.0**2)

for name, design in {"pid": pid, "pid and notch at the second bending mode": pid * notch}.items():
    model = ambid.Model(rig.replace(controller=ambid.controller_from(design)))
    print(f"{name}: {'stable' if model.is_stable else 'unstable'}, {len(model.poles())} poles")

# As it runs on the machine: sampled at 20 kHz by Tustin, half a sample late.
digital = control.sample_system(pid, 5e-5, method="tustin")
model = ambid.Model(rig.replace(controller=ambid.controller_from(digital, delay_samples=0.5)))
print(f"digital: {'stable' if model.is_stable else 'unstable'}")
print(ambid.check(model.rig))  # sensitivity with its zone of ISO 14839-3, and whatever looks wrong

# The closed loop from i_e to y and i_c, for python-control's own tools.
closed = ambid.to_control(model)
print(f"back in python-control: {closed.nstates} states, inputs {', '.join(closed.input_labels)}")
