"""Steps move a machine for a small part of a record: what a model misses then is seen beside what is left at rest."""

import numpy as np
import pytest

from ambid import Record, compare, identify
from ambid.model import Model
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS, SAMPLES = 1000.0, (300.0, 900.0, 12.0), 6000
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
LAW = {"kind": "state_space", "implementation": "digital", "reference": True, "inputs": ["y", "i_c"]}


def record(step: float, seed: int, truth: Levitator = TRUTH, wander: float = 0.0) -> Record:
    """One step in the middle, in noise that may be louder at times."""
    r = np.where(np.arange(SAMPLES) < SAMPLES // 2, 0.0, step)
    found = truth.run(RATE, pid(*GAINS, RATE, 0.4), r, np.zeros(SAMPLES), noise=(2e-6, 1e-3), seed=seed)
    random = np.random.default_rng(1000 + seed)
    loud = 1.0 + wander * np.repeat(random.random(SAMPLES // 500), 500)
    y, i_c = (own + loud[:, None] * size * random.standard_normal((SAMPLES, 1)) for own, size in
              ((found["y"], 2e-6), (found["i_c"], 1e-3)))  # fmt: skip
    own = {"y": y, "i_c": i_c, "i_e": np.zeros((SAMPLES, 1)), "r": r[:, None]}
    return Record.from_arrays(**own, sample_rate=RATE, axes=("A_zeta",), rig=TRUTH.rig(RATE, rig_law()))


def rig_law() -> dict:
    return LAW | pid_matrices(*GAINS, RATE, 0.4)


@pytest.mark.parametrize("wander", [0.0, 1.0])
@pytest.mark.parametrize("seeds", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_noise_is_hardly_ever_louder_in_motion(wander, seeds):
    model = Model(TRUTH.rig(RATE, rig_law()))
    loud = [compare(model, record(3e-4, seed, wander=wander)).adequacy.failed("motion") for seed in range(seeds)]
    assert sum(map(bool, loud)) <= 0.05 * seeds


def test_what_a_step_shows_is_not_lost_in_the_noise_of_the_rest():
    """A coil that is slower than the rig says, and cannot be absorbed: the misfit of the whole record has no trace."""
    slower = Levitator(TRUTH.mass, TRUTH.K_i, TRUTH.K_s, 1.1 * TRUTH.tau)
    step = record(3e-4, 1, slower)
    found = identify(TRUTH.rig(RATE, rig_law()), step)
    assert found.misfit < found.misfit_bound
    assert not found.is_adequate
    assert found.inconsistency.code == "residual_inconsistent"
    assert found.inconsistency.values["when"] == "in motion"
    assert found.inconsistency.values["ratio"] > 1.0
    codes = {own.code for own in found.comparison.records[0].findings}
    assert "residual_higher_in_motion" in codes
    assert codes <= {own.code for own in found.findings}


def test_a_record_that_moves_all_along_has_nothing_to_hold_against():
    model = Model(TRUTH.rig(RATE, rig_law()))
    r = np.repeat(3e-4 * np.random.default_rng(2).standard_normal(SAMPLES // 20), 20)
    found = TRUTH.run(RATE, pid(*GAINS, RATE, 0.4), r, np.zeros(SAMPLES), noise=(2e-6, 1e-3), seed=2)
    own = {"y": found["y"], "i_c": found["i_c"], "i_e": np.zeros((SAMPLES, 1)), "r": r[:, None]}
    moving = Record.from_arrays(**own, sample_rate=RATE, axes=("A_zeta",), rig=model.rig)
    assert "motion" not in {own.name for own in compare(model, moving).adequacy.tests}
