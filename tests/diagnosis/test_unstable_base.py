"""A levitator that stands because of back-EMF, which its rig file lacks: simulated by the matrix exponential alone."""

import numpy as np
import pytest

from ambid import Model, Record, compare, identify
from ambid.diagnosis import diagnose, holders, rank
from ambid.effects import find
from ambid.errors import ModelError, UnstableLoopError
from found import codes, the
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS, SAMPLES = 1000.0, (260.0, 400.0, 3.0), 6000
TRUTH = Levitator(mass=0.85, K_i=15.0, K_s=2780.0, tau=0.02, back_emf=15.0 / 4.2)
FEW = [find(name) for name in ("back_emf", "external_damping", "loop_delay", "sensor_lag", "force_nonlinearity")]
HOLD = {"back_emf", "external_damping"}


@pytest.fixture(scope="module")
def machine():
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    rig = TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital"} | matrices, off=-0.03)
    i_e = 0.05 * np.tile(np.random.default_rng(4).choice([-1.0, 1.0], SAMPLES // 6), 6)
    signals = TRUTH.run(RATE, pid(*GAINS, RATE), np.zeros(SAMPLES), i_e, noise=(2e-7, 2e-5))
    own = {"y": signals["y"], "i_c": signals["i_c"], "i_e": i_e[:, None]}
    return rig, Record.from_arrays(**own, sample_rate=RATE, axes=rig.axes, rig=rig, period=SAMPLES // 6)


def test_what_makes_the_base_stable_is_tried_and_evidence_decides(machine):
    rig, record = machine
    assert not Model(rig).is_stable
    found = diagnose(rig, record, catalogue=FEW)
    assert (found.verdict, found.effects) == ("explained", ("back_emf",))
    values = the(found, "base_unstable").values
    assert set(values["effects"]) == HOLD
    assert values["growth_per_s"] == pytest.approx(Model(rig).poles()[0].real)
    for name, value in {"K_i.A_zeta": TRUTH.K_i, "K_s.A_zeta": TRUTH.K_s}.items():
        own = found.parameters[name]
        assert own.ci95[0] < value < own.ci95[1]
    assert found.history[0].effects == ("back_emf",)
    assert found.explained_percent > 99.0


def test_the_model_that_stands_is_identified_compared_and_ranked(machine):
    rig, record = machine
    model = diagnose(rig, record, effects=["back_emf"]).model
    estimate = identify(model, record)
    assert estimate.comparison.is_adequate
    assert compare(estimate.model, record).is_adequate
    assert "loop_delay" in [own.effect.name for own in rank(estimate.comparison).candidates]


def test_a_choice_that_holds_nothing_is_refused_with_what_does(machine, golden):
    rig, record = machine
    assert set(holders(Model(rig), FEW)) == HOLD
    with golden.raises(ModelError):
        diagnose(rig, record, effects=["loop_delay"], catalogue=FEW)


def test_a_base_that_nothing_holds_is_refused_with_its_pole(machine):
    rig, record = machine
    found = diagnose(rig, record, catalogue=[find("loop_delay"), find("sensor_lag")])
    assert found.verdict == "not_informative"
    values = the(found, "base_unstable_with_every_effect").values
    assert values["growth_per_s"] > 0.0
    assert "base_unstable" not in codes(found)
    with pytest.raises(UnstableLoopError):
        compare(rig, record)
