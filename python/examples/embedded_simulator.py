"""The embedded simulator: one sample at a time, as a controller test bench would call it.

The same in Rust, without Python: ``rust/core/examples/embedded.rs``.
"""

import time

import numpy as np

import ambid
from ambid.demo import DATA

rig = ambid.Rig.load(DATA / "rig.toml")
record = ambid.Record.load(DATA / "prbs.mat", rig)
model = ambid.identify(rig, record).model

simulator = model.simulator()
print("inputs ", *simulator.inputs)
print("outputs", *simulator.outputs)

# A push on one axis for 1 ms, sample by sample: outputs of this instant, for the excitation from here to the next.
pushed = np.array([[0.5 if k < 10 else 0.0, 0.0, 0.0, 0.0] for k in range(2000)])
begun = time.perf_counter()
outputs = np.array([simulator.step(u) for u in pushed])
each = (time.perf_counter() - begun) / len(pushed)
print(f"largest y.A_zeta {1e6 * abs(outputs[:, 0]).max():.2f} um, {1e6 * each:.0f} us a step from Python")

# Exactly what the whole record gives.
simulator.reset()
stepped, whole = simulator.run(pushed), model.simulate(pushed)
print(f"stepped and simulated at once differ by {abs(stepped[:, :4] - whole.y).max():.1e} m")
