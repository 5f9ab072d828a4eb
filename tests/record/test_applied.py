"""i_e that was logged beside the command: a clip of the command is an excitation, and another law is reported."""

import numpy as np
import pytest

from ambid import Model, Record, Rig, check, compare
from ambid.excitation import prbs
from found import codes, the
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS, LIMIT = 1000.0, (300.0, 900.0, 12.0), 0.09
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
I_E = np.tile(prbs(7, amplitude=0.05, hold=4)[:, 0], 12)


def rig(gains=GAINS) -> Rig:
    matrices = pid_matrices(*gains, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    return TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital"} | matrices)


def record(gains=GAINS, limit: float = np.inf) -> Record:
    signals = TRUTH.run(RATE, pid(*GAINS, RATE), np.zeros(len(I_E)), I_E, noise=(1e-6, 1e-4), limit=limit)
    cut = {name: own[100:] for name, own in (signals | {"i_e": I_E[:, None]}).items()}
    return Record.from_arrays(**cut, sample_rate=RATE, axes=("A_zeta",), rig=rig(gains))


def test_a_clipped_command_is_what_was_applied():
    own = record(limit=LIMIT)
    at_limit = np.abs(own.i_ref[:, 0]) == LIMIT
    off = own.i_e[:, 0] - I_E[100:]
    assert 0.01 < at_limit.mean() < 0.3
    assert np.abs(off[~at_limit]).max() < 1e-3 * LIMIT
    assert np.median(np.abs(off[at_limit])) > 0.1 * LIMIT
    assert own.has_known_command
    assert own.excitation_source == "applied_command"
    assert {"excitation_as_applied", "command_clipped"} <= set(codes(own))
    assert compare(Model(rig()), own).is_adequate
    assert check(rig(), [own]).is_sound


def test_a_command_that_follows_leaves_i_e_as_it_was_logged():
    own = record()
    np.testing.assert_array_equal(own.i_e[:, 0], I_E[100:])
    assert own.findings == ()
    assert not own.has_known_command


@pytest.mark.parametrize("limit", [np.inf, LIMIT], ids=["free", "clipped"])
def test_another_law_is_told_and_nothing_is_changed(limit):
    own = record((360.0, 900.0, 9.0), limit)
    np.testing.assert_array_equal(own.i_e[:, 0], I_E[100:])
    found = the(own, "command_unexplained")
    assert found.where.channel == "i_ref.A_zeta"
    assert found.values["share"] > found.values["limit"]
