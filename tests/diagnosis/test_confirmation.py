"""What looks like physics in one part of a record only is no explanation; nor is a size that stands at its limit."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import diagnose
from ambid.effects import find
from hidden.null_cells import made
from hidden.one_axis import NAMED, ONE_AXIS, record
from tiers import first_fast

RIG = ONE_AXIS.rig


def weak(effect, seed, share):
    """A record with so much of an effect that chance alone hardly brings it."""
    return record({effect: {name: share * value for name, value in NAMED[effect].items()}}, seed)


@pytest.mark.parametrize("seed", first_fast(range(3)))
def test_a_weak_effect_that_is_there_all_the_time_is_still_named(seed):
    found = diagnose(RIG, weak("sensor_lag", seed, 0.08))
    assert found.history[0].misfit < 1.1
    assert "sensor_lag" in {*found.effects, *(name for names in found.ambiguous_sets for name in names)}, found


@pytest.mark.parametrize("frequency", first_fast([50.37, 50.0]))
@pytest.mark.parametrize("seed", first_fast(range(2)))
def test_a_weak_hum_that_is_there_all_the_time_is_named(seed, frequency):
    """Two tenths of a milliampere: each half shows its lines, while the misfit of all lines is within its bound."""
    hum = {"periodic_disturbance": {"frequency_hz": frequency, "amplitude": 2e-4, "port": "current"}}
    found = diagnose(RIG, record(hum, seed))
    assert found.history[0].misfit < 1.15
    assert found.effects == ("periodic_disturbance",), found


@pytest.mark.slow
def test_noise_that_is_louder_than_its_spectrum_on_one_line_is_no_wave():
    """Of 32 channels: a score by chance in a million, in one of 350 records, where the lines beside are as loud."""
    waves = [find(name) for name in ("periodic_disturbance", "sensor_runout", "unbalance")]
    assert diagnose(*made(328), catalogue=waves).effects == ()


@pytest.mark.parametrize(("seeds", "most"), [([7], 0), pytest.param(range(6), 2, marks=pytest.mark.slow)])
def test_what_is_in_one_half_only_is_not_named(seeds, most):
    """A gain of y that is 0.1 % off in the first half: small enough to leave the base model adequate."""
    named = 0
    for seed in seeds:
        clean = record({}, seed)
        y = np.array(clean.y)
        y[: len(y) // 2] *= 1.001
        found = diagnose(RIG, replace(clean, y=y))
        assert found.history[0].misfit < 1.1
        named += bool(found.effects)
    assert named <= most
