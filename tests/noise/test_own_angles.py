"""The angle of waves in records that were kept back: the best there is, for a model that is right the one it has."""

from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.effects.disturbance import PeriodicDisturbance
from ambid.noise import Comparison
from hidden.bench import measured
from hidden.families import BENCHES
from tiers import first_fast

BENCH = replace(BENCHES["small"], order=7)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", first_fast([63.37, 50.0]))
def test_a_loud_wave_keeps_the_angle_that_fits(frequency):
    """A thousand times the noise: a thousandth of a radian beside the best is seen, and J is no cosine over it."""
    hum = {"periodic_disturbance": {"frequency_hz": frequency, "amplitude": 0.3, "port": "current", "axis": 1}}
    i_e = BENCH.excitation(BENCH.amplitude, 1)
    train, kept_back = (measured(BENCH.rig, i_e, hum, seed=k, **BENCH.truth, **BENCH.noise) for k in (1, 2))
    wave = PeriodicDisturbance(frequency, "current", 1, 1)
    model = ambid.identify(ambid.Model(BENCH.rig).add(wave), train).model
    own = Comparison(model, [train])
    assert own.misfit == pytest.approx(1.0, abs=0.06)
    assert own.with_own_angles().cost <= own.cost * (1.0 + 1e-9)
    turned = ambid.compare(model, kept_back)
    assert turned.misfit == pytest.approx(1.0, abs=0.06)
    assert np.isfinite(turned.cost)
