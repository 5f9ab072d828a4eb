"""Identify a measured rig: K_i, K_s and tau_e from one record of the levitated rotor."""

import tempfile
from pathlib import Path

import ambid
from ambid.demo import DATA

# What is known of the machine, and what was measured. Put your own files here.
rig = ambid.Rig.load(DATA / "rig.toml")
record = ambid.Record.load(DATA / "prbs.mat", rig)
print(record)

# Before any fit: does the record belong to this rig file? Units, signs, columns, gains.
print(ambid.check(rig, [record]))

estimate = ambid.identify(rig, record)
print(estimate)  # values, 95 % intervals, fit beside the fit that noise allows

# Is anything missing? A misfit of 1 is noise alone.
comparison = ambid.compare(estimate.model, record)
print(f"misfit {comparison.records[0].misfit:.2f}")

# Keep the model with its covariance, for `ambid compare --model model.json` and for `Model.load`.
with tempfile.TemporaryDirectory() as folder:
    estimate.save(Path(folder) / "model.json")
    again = ambid.Model.load(Path(folder) / "model.json")
print(f"tau_e of the model that was saved: {again.parameters[-1].value * 1e3:.3f} ms")
