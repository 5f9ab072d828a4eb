"""A sign that is opposite in a levitator's record is reported as that, with the channel, and not as another machine."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Record, check
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS = 1000.0, (300.0, 900.0, 12.0)
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)


def record() -> tuple:
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    rig = TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital", "reference": True} | matrices)
    r = np.repeat(2e-4 * np.random.default_rng(1).standard_normal(60), 100)
    signals = TRUTH.run(RATE, pid(*GAINS, RATE), r, 0.0 * r, noise=(1e-6, 1e-4))
    return rig, Record.from_arrays(**signals, r=r[:, None], sample_rate=RATE, axes=rig.axes, rig=rig)


@pytest.mark.parametrize("turned", ["y", "r"])
def test_of_a_record_without_a_command(turned):
    rig, own = record()
    own = replace(own, i_ref=None)
    assert check(rig, [own]).is_sound
    (error,) = check(rig, [replace(own, **{turned: -getattr(own, turned)})]).errors
    assert (error.code, error.values["signals"], error.where.channel) == ("opposite_sign", [turned], turned)


def test_of_y_where_the_machine_alone_shows_it():
    rig, own = record()
    rebuilt = Record.from_arrays(
        y=-own.y, r=own.r, i_c=own.i_c, i_ref=own.i_ref, sample_rate=RATE, axes=rig.axes, rig=rig
    )
    (error,) = check(rig, [rebuilt]).errors
    assert (error.code, error.values["signals"]) == ("opposite_sign", ["y"])
    assert error.values["correlation"] < 0.0


def test_of_a_reference_where_i_e_is_rebuilt_from_the_command():
    rig, own = record()
    rebuilt = Record.from_arrays(
        y=own.y, r=-own.r, i_c=own.i_c, i_ref=own.i_ref, sample_rate=RATE, axes=rig.axes, rig=rig
    )
    (error,) = check(rig, [rebuilt]).errors
    assert (error.code, error.values["signals"], error.where.channel) == ("opposite_sign", ["r"], "r")
