"""Fits that sharp resonances or the edge of stability keep from their optimum: found where all is damped more."""

import numpy as np
import pytest

from ambid.identification import identify
from ambid.identification.damped import damped_start
from ambid.model import Model
from benchmarks.null_cells import made
from hidden.bench import measured
from hidden.families import BENCHES

LIGHTLY_DAMPED = 1441
"""A spindle with modes of 0.1 %: from the rig's values the fit ran into the edge of stability, with a J/dof of 2321."""

AT_THE_EDGE = 1056
"""A record of 0.1 s, in which a mode decays so slowly that the likeliest loop of one that fades is unstable."""


@pytest.mark.parametrize("index", [LIGHTLY_DAMPED, AT_THE_EDGE])
def test_an_optimum_beyond_sharp_modes_is_found_from_nominal_values(index):
    rig, record = made(index)
    found = identify(rig, record)
    assert found.status == "converged"
    assert found.misfit < 1.05
    assert found.model.is_stable


@pytest.mark.parametrize("seed", range(3))
def test_a_start_far_off_leads_near_the_optimum(seed):
    bench = BENCHES["bench"]
    record = measured(bench.rig, bench.excitation(bench.amplitude, seed), {}, seed=seed, **bench.truth, **bench.noise)
    model = Model(bench.rig)
    far = model.with_values(
        {name: 1.25 * model.theta[model.names.index(name)] for name in model.names if "K_s" in name}
    )
    if not far.is_stable:
        pytest.skip("no loop to start from")
    free = list(range(len(model.names)))
    x, evaluations = damped_start(far, [record], free, (np.zeros(len(free)), np.full(len(free), np.inf)))
    nearest = identify(model, record).model.theta / [p.scale for p in far.parameters]
    assert evaluations > 0
    np.testing.assert_allclose(x, nearest, rtol=0.02)
