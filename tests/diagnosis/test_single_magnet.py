"""A single magnet that holds a weight, by an integrator of its own: its force law is tried, named, and comes right."""

import numpy as np
import pytest

from ambid import Record, compare, diagnose, rank
from ambid.diagnosis.ranking import see
from ambid.effects import find
from ambid.effects.magnet import HOLDING, FluxSaturation, ForceNonlinearity
from ambid.model import Model
from reference.levitator import Levitator, pid, pid_matrices
from tiers import first_fast

RATE, GAINS, SAMPLES = 1000.0, (300.0, 900.0, 12.0), 1200
BIAS, GAP = 0.9, 0.005
TRUTH = Levitator(0.06, 1.3, 1.3 * BIAS / GAP, 0.005, gap=GAP, bias=BIAS, single=True)


def rig():
    law = {"kind": "state_space", "implementation": "digital", "reference": True, "inputs": ["y", "i_c"]}
    return TRUTH.rig(RATE, law | pid_matrices(*GAINS, RATE, 0.4), off=0.03)


def record(size: float, seed: int, holding: float = BIAS) -> Record:
    """References and excitations that jump, from rest, about the current that holds the weight."""
    random = np.random.default_rng(seed)
    r = np.repeat(size * random.standard_normal(SAMPLES // 50), 50)
    r[:50] = 0.0
    i_e = 100.0 * size * random.standard_normal(SAMPLES)
    found = TRUTH.run(RATE, pid(*GAINS, RATE, 0.4), r, i_e, noise=(1e-6, 5e-4), seed=seed)
    own = {"y": found["y"], "i_c": found["i_c"] + holding, "i_e": i_e[:, None], "r": r[:, None]}
    return Record.from_arrays(**own, sample_rate=RATE, axes=("A_zeta",), rig=rig())


@pytest.mark.parametrize("holding", first_fast([BIAS, 0.0]))
def test_the_law_of_a_single_magnet_is_named_and_the_values_come_right(holding):
    """Also where i_c is stated about what carries the weight, which then shows nothing of the magnets."""
    few = [ForceNonlinearity(), FluxSaturation(), find("sensor_lag"), find("back_emf")]
    found = diagnose(rig(), record(1e-4, 1, holding), validate=[record(7e-5, 2, holding)], catalogue=few)
    assert found.effects == ("force_nonlinearity",), found
    assert found.history[0].fit_percent["average"] < 90.0 < 97.0 < found.history[-1].fit_percent["average"]
    assert found.model.effects[0] == ForceNonlinearity(single=True)
    truth = {"K_i.A_zeta": TRUTH.K_i, "K_s.A_zeta": TRUTH.K_s, "force_nonlinearity.bias_ratio": 1.0}
    for name, value in truth.items():
        estimate = found.parameters[name]
        assert abs(estimate.value - value) < 4.0 * estimate.std_error, (name, estimate)
        assert abs(estimate.value - value) < 0.05 * value, (name, estimate)


@pytest.mark.parametrize(
    ("holding", "single"), [(0.0, [False, True]), (0.9 * HOLDING * BIAS, [False]), (1.1 * BIAS, [True])]
)
def test_the_mean_current_tells_a_pair_from_a_single_magnet(holding, single):
    seen = see(compare(Model(rig()), record(2e-5, 3, holding)))
    assert [law.single for law in ForceNonlinearity().variants(seen)] == single
    assert [law.single for law in FluxSaturation().variants(seen)] == single


def test_both_laws_are_judged_where_the_holding_current_is_beyond_the_bias():
    ranking = rank(compare(Model(rig()), record(2e-5, 3, 1.2 * BIAS)))
    assert ranking.find("force_nonlinearity") is not None
    assert ranking.find("flux_saturation") is not None
