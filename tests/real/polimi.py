"""Real hardware: a levitator that can be bought, driven by its reference alone, from the ideal coil on.

    python tests/real/polimi.py FOLDER

The records are from github.com/Bocchio01/062020-Lab-Mechatronics (MIT licence): INTECO MLS2EM, upper coil.
"""

from __future__ import annotations

from pathlib import Path

import scipy.io

from ambid import Record, Rig

VOLTS, OFFSET = 11.658, -0.561  # of the driver, per unit of control


def rig_of(folder: Path) -> Rig:
    """That of the PID, which acts on the error to the reference."""
    rig = Rig.load(folder / "rig_pid.toml")
    return rig.replace(controller=rig.controller.model_copy(update={"reference": True}))


def record_of(path: Path, rig: Rig, rows: slice) -> Record:
    """Rows of a file as a record: y and r towards the coil [m], i_c [A], the command [V] as i_ref."""
    _, r, z, _, current, _, control = scipy.io.loadmat(path)["logouts"][:7, rows]
    return Record.from_arrays(
        y=-z[:, None], r=-r[:, None], i_c=current[:, None], i_ref=VOLTS * control[:, None] + OFFSET,
        sample_rate=rig.sample_rate, axes=rig.axes, rig=rig, name=path.stem.split("__")[0],
    )  # fmt: skip
