"""A plan of small experiments on one axis, and what its runs leave on the disk."""

from ambid.excitation import prbs
from ambid.monte_carlo import Plan
from hidden.one_axis import ONE_AXIS

RIG = ONE_AXIS.rig
RUNS, CHUNK = 9, 4
"""Of a job in three parts, the last of one run."""


def plan(**changes):
    given = {"rig": RIG, "excitation": prbs(7, amplitude=1.0, hold=4, axes=1, periods=4), "seed": 4}
    return Plan(**given | changes)


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}
