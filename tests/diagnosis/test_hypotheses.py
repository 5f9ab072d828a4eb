"""Sets of effects: without noise, and what the states of effects may do when a record begins."""

import numpy as np
import pytest

from ambid import diagnose
from hidden.bench import simulate
from hidden.dirt import MARGIN, NOISE_FREE, soiled
from hidden.families import BENCHES
from hidden.sizes import sized


@pytest.mark.slow
def test_without_any_noise_nothing_is_left():
    """Of this record the cost of the right model is zero in all digits."""
    bench = BENCHES["bench"]
    one = bench.excitation(bench.amplitude, 2)[: bench.period]
    i_e = np.take(one, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    hidden = {"seal_forces": sized("seal_forces", "clear").parameters}
    record = simulate(bench.rig, i_e, hidden, period=bench.period, seed=None, **bench.truth)
    found = diagnose(bench.rig, soiled(record, NOISE_FREE, np.random.default_rng(2), bench.rig))
    assert found.effects == ("seal_forces",)
    assert found.history[-1].misfit < 1e-8
