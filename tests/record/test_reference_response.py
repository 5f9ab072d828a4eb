"""Frequency responses of records that a reference drives, alone or beside i_e."""

import numpy as np
import pytest

from ambid import Model, Record, Rig, compare
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS, SAMPLES = 1000.0, (300.0, 900.0, 12.0), 6000
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
DRIVES = 1e-4 * np.random.default_rng(1).standard_normal(SAMPLES), 0.02 * np.random.default_rng(2).normal(size=SAMPLES)


def rig() -> Rig:
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    own = {"kind": "state_space", "implementation": "digital", "reference": True}
    return TRUTH.rig(RATE, own | matrices)


@pytest.mark.parametrize("with_i_e", [False, True])
def test_it_is_that_of_the_loop(with_i_e):
    r, i_e = DRIVES[0], DRIVES[1] * with_i_e
    found = TRUTH.run(RATE, pid(*GAINS, RATE), r, i_e, noise=(1e-7, 1e-4))
    own = rig()
    record = Record.from_arrays(
        y=found["y"], i_c=found["i_c"], r=r[:, None], i_e=i_e[:, None], sample_rate=RATE, axes=own.axes, rig=own
    )
    response = record.frequency_response()
    assert response.inputs == (("i_e.A_zeta", "r.A_zeta") if with_i_e else ("r.A_zeta",))
    model = Model(own)
    assert compare(model, response).misfit < 1.3
    (one,) = compare(model, response).records
    errors = np.abs(response.response - one.simulated) / response.std
    assert np.median(errors, axis=0).max() < 1.2  # 0.83 of normal ones
    assert [channel.unit[-1] for channel in one.channels] == ["A" if with_i_e else "m"] * 2


def test_lines_that_nothing_moves_are_left_out():
    lines = np.exp(2j * np.pi * np.random.default_rng(3).random(1001)) * (np.arange(1001) < 120)
    one = np.fft.irfft(lines)
    r = np.round(np.tile(one / one.std(), 5) * 1e5) * 1e-9  # as a file with six digits holds it
    found = TRUTH.run(RATE, pid(*GAINS, RATE), r, 0.0 * r, noise=(1e-7, 1e-4))
    own = rig()
    signals = {"y": found["y"], "i_c": found["i_c"], "r": r[:, None]}
    record = Record.from_arrays(**signals, sample_rate=RATE, axes=own.axes, rig=own)
    response = record.frequency_response()
    assert 50.0 < response.frequency_hz.max() < 60.0
    (channel, *_) = compare(Model(own), response).records[0].channels
    assert channel.fit_percent > 90.0
