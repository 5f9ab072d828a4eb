"""Real hardware: a levitator that can be bought, driven by its reference alone, from the ideal coil on.

    python tests/real/polimi.py FOLDER

The records are from github.com/Bocchio01/062020-Lab-Mechatronics (MIT licence): INTECO MLS2EM, upper coil.
"""

from __future__ import annotations

import sys
from pathlib import Path

import scipy.io

from ambid import Record, Rig, StateSpaceController, check, diagnose

VOLTS, OFFSET = 11.658, -0.561  # of the driver, per unit of control


RATE, FORGETS = 1000.0, 0.8186666666666667
POSITION, SPEED, CURRENT, TOTAL = 287.01398781, 6.2578892, 1.29916672, 447.2135955
"""Gains of the LQI on filtered position and speed, current, and the sum of the filtered error; from its records."""


def pid_rig(folder: Path) -> Rig:
    """That of the PID, which acts on the error to the reference."""
    rig = Rig.load(folder / "rig_pid.toml")
    return rig.replace(controller=rig.controller.model_copy(update={"reference": True}))


def lqi_rig(folder: Path) -> Rig:
    """That of the state feedback with an integral; states: filtered y, that a sample before, the sum of the error."""
    law = StateSpaceController(
        implementation="digital",
        inputs=("y", "i_c", "r"),
        A=((FORGETS, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0 / RATE, 0.0, 1.0)),
        B=((1.0 - FORGETS, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0 / RATE)),
        C=((VOLTS * (POSITION + RATE * SPEED), -VOLTS * RATE * SPEED, VOLTS * TOTAL),),
        D=((0.0, VOLTS * CURRENT, 0.0),),
    )
    return Rig.load(folder / "rig_pid.toml").replace(controller=law)


def record_of(path: Path, rig: Rig, rows: slice) -> Record:
    """Rows of a file as a record: y and r towards the coil [m], i_c [A], the command [V] as i_ref."""
    _, r, z, _, current, _, control = scipy.io.loadmat(path)["logouts"][:7, rows]
    return Record.from_arrays(
        y=-z[:, None], r=-r[:, None], i_c=current[:, None], i_ref=VOLTS * control[:, None] + OFFSET,
        sample_rate=rig.sample_rate, axes=rig.axes, rig=rig, name=path.stem.split("__")[0],
    )  # fmt: skip


def main(folder: Path) -> None:
    """Laws, verdicts and parameters of the step of the PID and of the first step of the LQI, 10 to 12 mm both."""
    runs = (
        (pid_rig(folder), "step__PID_anti_windup-KF.mat", slice(3000, 10000)),
        (lqi_rig(folder), "multisteps_updown__LQI-low_pass.old.mat", slice(1500, 5900)),
    )
    for rig, name, rows in runs:
        record = record_of(folder / name, rig, rows)
        print(record, *record.notes, sep="\n  ")
        for law in check(rig, [record]).laws.get(record.name, ()):
            print(law.line())
        found = diagnose(rig, record)
        print(found)
        for parameter, value in found.parameters.items():
            print(f"{parameter:36s} {value.value:10.4g} +- {1.96 * value.std_error:.2g} {value.unit}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
