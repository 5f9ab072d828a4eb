"""What records determine: continuous up to a limit that is reported from both sides."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ambid import Model, Rig, prbs
from ambid.identification import identify
from ambid.identification.identifiability import NEAR_FREE_MOTION, NEAR_LIMIT
from places import LEVITATOR
from virtual import NAMES

PERIOD = 510
ALONE = prbs(8, amplitude=0.15, hold=2, axes=4, periods=6) * [1.0, 0.0, 0.0, 0.0]
"""Excitation of one axis."""


def of_code(found, kind):
    return [finding for finding in found.findings if finding.code == kind.code]


def test_the_limit_is_reported_from_both_sides():
    """The weaker the excitation, the larger the relative standard deviation; far from the limit it is not reported."""
    model = Model(Rig.load(LEVITATOR))
    deviations, is_lost = [], []
    for amplitude in np.geomspace(3e-4, 3e-3, 7):
        i_e = prbs(7, amplitude=amplitude, hold=4, axes=1, periods=4)
        found = identify(model, model.virtual_experiment(i_e, seed=1))
        near = of_code(found, NEAR_LIMIT)
        deviations.append(max((own.values["relative_std_error"] for own in near), default=None))
        is_lost.append(found.status == "not_identifiable")
    assert is_lost[0]
    assert not is_lost[-1]
    assert None in deviations
    for k, (before, after) in enumerate(pairwise(is_lost)):
        if before != after:
            assert 1.0 < deviations[k] < 2.0
            assert 0.5 < deviations[k + 1] < 1.0


def begun(bench, push, seed=5):
    """A fit to excitation along A_zeta alone, the whole rotor still moving from a push on all axes before [A]."""
    before = np.zeros((PERIOD, 4))
    before[-60:-40] = push
    record = bench.records(np.vstack([before, ALONE]), [seed])[0]
    signals = {name: getattr(record, name)[PERIOD:] for name in ("i_e", "y", "i_c")}
    return identify(Model(bench.rig(off=0.03)), replace(record, period=PERIOD, **signals))


@pytest.mark.slow
def test_the_limit_of_free_motion_is_reported_from_both_sides(bench):
    fits = [begun(bench, push) for push in np.geomspace(0.03, 0.3, 10)]
    near = [[own.values["relative_std_error"] for own in of_code(found, NEAR_FREE_MOTION)] for found in fits]
    is_lost = [found.status == "not_identifiable" for found in fits]
    assert is_lost[0]
    assert not is_lost[-1]
    assert [] in near
    for k, (before, after) in enumerate(pairwise(is_lost)):
        if before != after:
            assert 0.05 < near[k][0] < 0.1
            assert 0.025 < near[k + 1][0] < 0.05


@pytest.mark.parametrize("seeds", [3, pytest.param(9, marks=pytest.mark.slow)], ids="{} seeds".format)
def test_free_motion_of_noise_determines_nothing(bench, seeds):
    missed = {name for name in NAMES if "eta" in name and "zeta" not in name}
    for seed in range(seeds):
        found = begun(bench, 0.0, seed)
        assert found.status == "not_identifiable"
        assert not of_code(found, NEAR_FREE_MOTION)
        assert {name for direction in found.directions for name in direction} == missed
