"""A reference that was recorded and does not move drives nothing: i_e is rebuilt as without it."""

import numpy as np
import pytest

from ambid import Record, Rig, identify
from ambid.errors import RecordError
from found import codes
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS, SAMPLES = 1000.0, (300.0, 900.0, 12.0), 4000
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
I_E = 0.02 * np.random.default_rng(4).standard_normal(SAMPLES)


def rig(**changes) -> Rig:
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    own = {"kind": "state_space", "implementation": "digital", "reference": True}
    return TRUTH.rig(RATE, own | matrices | changes)


def record(signals, own) -> Record:
    return Record.from_arrays(**signals, sample_rate=RATE, axes=own.axes, rig=own, name="run")


def measured(set_point: float, i_e=I_E) -> dict[str, np.ndarray]:
    r = np.full(len(i_e), set_point)
    found = TRUTH.run(RATE, pid(*GAINS, RATE), r, i_e, noise=(1e-7, 1e-5))
    return {"y": found["y"], "i_c": found["i_c"], "r": r[:, None]}


@pytest.mark.parametrize("set_point", [0.0, 1e-4])
def test_the_excitation_is_rebuilt_about_it(set_point):
    found = record(measured(set_point), rig())
    assert found.excitation_source == "rebuilt_from_current"
    away = found.i_e[500:-10, 0] - (I_E - I_E.mean())[500:-10]
    assert away.std() < 0.05 * I_E.std()
    estimate = identify(rig(), found)
    for name, true in (("K_i.A_zeta", TRUTH.K_i), ("K_s.A_zeta", TRUTH.K_s)):
        assert estimate.parameters[name].value == pytest.approx(true, rel=0.05)


def test_a_record_that_begins_far_from_it_is_still_driven():
    assert record(measured(1e-3), rig()).excitation_source == "rebuilt_from_current"


def test_a_column_of_zeros_changes_nothing():
    signals = measured(0.0)
    without = record({name: own for name, own in signals.items() if name != "r"}, rig())
    assert np.array_equal(record(signals, rig()).i_e, without.i_e)


def test_neither_command_nor_current_leaves_it_unknown_and_tells_the_metres(golden):
    signals = {name: own[2000:] for name, own in measured(1e-4).items() if name != "i_c"}
    with golden.raises(RecordError):
        record(signals, rig())


def test_coming_to_rest_about_a_set_point_is_still_a_free_response():
    i_e = np.where(np.arange(1600) < 100, 0.1, 0.0)
    signals = {name: own[100:] for name, own in measured(1e-4, i_e).items()}
    found = record(signals, rig())
    assert found.is_free_response
    assert found.i_c is not None
    assert found.excitation_source == "assumed_zero"
    assert "comes_to_rest" in codes(found)
