"""A set-point or a load that moves slowly is reported as operating points, from where to where; nothing else is."""

import numpy as np
import pytest

from ambid import Finding, Record, check, diagnose, prbs
from reference.levitator import Levitator, pid, pid_matrices
from tiers import first_fast
from virtual import VirtualBench

RATE, GAINS, PERIOD, PERIODS = 1000.0, (300.0, 900.0, 12.0), 254, 12
RAMP = np.linspace(0.0, 1.0, PERIOD * PERIODS)


def record(seed: int, *, set_point=0.0, load=0.0, **physics):
    """Noise that repeats, beside a set-point [m] and a load [A of coil current] that nobody recorded."""
    machine = Levitator(0.06, 1.3, 95.0, 0.005, **physics)
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    rig = machine.rig(RATE, {"kind": "state_space", "implementation": "digital"} | matrices, off=0.05)
    i_e = prbs(7, amplitude=0.05, hold=2, axes=1, periods=PERIODS)[:, 0]
    r, lost = set_point * np.ones(len(RAMP)), load * np.ones(len(RAMP))
    found = machine.run(RATE, pid(*GAINS, RATE), r, i_e + lost, noise=(1e-7, 1e-4), seed=seed)
    own = {"y": found["y"], "i_c": found["i_c"] - lost[:, None], "i_e": i_e[:, None]}
    return rig, Record.from_arrays(**own, sample_rate=RATE, axes=rig.axes, rig=rig)


def shown(rig, measured) -> list[Finding]:
    return [found for found in check(rig, [measured]).findings if found.code == "operating_point_drift"]


@pytest.mark.parametrize("size", first_fast([2e-5, 2e-4]))
def test_a_set_point_that_ramps_is_told_with_its_ends(size):
    """The smaller one is less than the excitation moves the mass, and took half of the misfit with it."""
    rig, measured = record(1, set_point=size * RAMP)
    (drift,) = shown(rig, measured)
    assert drift.values["displacements"] == ["y.A_zeta"]
    (begin,), (end,) = drift.values["displacement_begin_m"], drift.values["displacement_end_m"]
    assert end - begin == pytest.approx(size * (PERIODS - 2) / PERIODS, rel=0.15)
    found = diagnose(rig, measured)
    assert found.effects == ()
    assert drift in found.findings
    assert not any(own.code == "parameter_seems_to_change" for own in found.findings)


def test_a_load_that_ramps_is_told_by_the_current():
    (drift,) = shown(*record(2, load=0.05 * RAMP))
    assert drift.values["currents"] == ["i_c.A_zeta"]
    (begin,), (end,) = drift.values["current_begin_a"], drift.values["current_end_a"]
    assert end - begin == pytest.approx(-0.05 * (PERIODS - 2) / PERIODS, rel=0.15)


@pytest.mark.parametrize("back_emf", [0.0, 2.0])
def test_a_start_from_elsewhere_is_no_ramp(back_emf):
    """Whatever the model misses: no model is asked."""
    assert shown(*record(3, set_point=2e-5, back_emf=back_emf)) == []


@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(own, marks=pytest.mark.slow) for own in range(3, 10))])
def test_a_record_that_stays_is_not_said_to_move(seed):
    assert shown(*record(seed)) == []


def test_noise_on_four_axes_is_not_said_to_move():
    bench, i_e = VirtualBench(), prbs(7, amplitude=0.15, hold=2, axes=4, periods=12)
    for run in bench.records(i_e, range(8), period=254):
        assert shown(bench.rig(), run) == []
