"""The files of the demo's story, of a mass on one axis."""

import json
from pathlib import Path

import numpy as np

from hidden.bench import simulate
from hidden.one_axis import ONE_AXIS

DELAY = 5e-5


def one_axis(folder: Path) -> Path:
    """The same files as those of the demo, of a mass on one axis: a record, two with a late loop, and loadings."""
    own, names = ONE_AXIS, ("K_i.A_zeta", "K_s.A_zeta", "tau_e")
    own.rig.exact().save(folder / "rig.toml")
    late = {"loop_delay": {"seconds": DELAY}}
    records = {"prbs": ({}, 1.0, 1), "hidden_train": (late, 1.0, 2), "hidden_validate": (late, 0.5, 3)}
    for name, (hidden, share, seed) in records.items():
        i_e = own.excitation(share * own.amplitude, seed)
        simulate(own.rig, i_e, hidden, seed=seed, **own.truth, **own.noise).save(folder / f"{name}.mat")
    values = dict(zip(names, (*own.K_i, *own.K_s, own.tau_e), strict=True)) | {"loop_delay.delay": DELAY}
    (folder / "hidden_truth.json").write_text(json.dumps(values))
    position = own.rig.bearings[0].position
    for k in range(1, 4):
        force = 20.0 * np.arange(4) * k
        rows = np.column_stack([np.arange(4), np.full(4, position), force, 0.0 * force, -force / own.K_i[0]])
        np.savetxt(folder / f"static_{k}.csv", rows, "%.9g", ",", header="step,z,F_x,F_y,i_c.A_zeta", comments="")
    return folder
