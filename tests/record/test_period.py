"""Periods found, over random seeds."""

import numpy as np
import pytest

from ambid.excitation import multisine, prbs
from ambid.record.repeats import find_period


@pytest.mark.parametrize("seed", range(30))
def test_period_is_found(seed):
    """Any shift, any number of samples after the last whole period, exact or measured with noise below 1e-3."""
    rng = np.random.default_rng(seed)
    order, hold = rng.integers(4, 9), rng.integers(1, 6)
    period = (2**order - 1) * hold
    whole = prbs(int(order), amplitude=0.5, hold=int(hold), axes=3, periods=6, seed=seed)
    x = whole[rng.integers(0, period) :][: int(period * rng.uniform(2, 4.9))]
    assert find_period(x) == period
    assert find_period(x + rng.normal(0, 0.5 * 4e-4, x.shape)) == period
    assert find_period(x + rng.normal(0, 0.05, x.shape), tolerance=0.3) == period
    assert find_period(x + rng.normal(0, 0.05, x.shape)) is None


@pytest.mark.parametrize("seed", range(5))
def test_period_of_a_multisine(seed):
    rng = np.random.default_rng(seed)
    x = multisine(901, rms=0.3, lines=np.arange(1, 200), axes=4, periods=4, phases="random", seed=seed)[:3000]
    assert find_period(x) == 901
    assert find_period(x + rng.normal(0, 1e-4, x.shape)) == 901


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("lines", [range(1, 12), range(100, 140), range(40, 400, 3)], ids=["slow", "narrow", "odd"])
def test_period_in_noise(lines, seed):
    """A slow or narrow-band signal nearly repeats long before its period; noise of a quarter of it hides neither."""
    rng = np.random.default_rng(seed)
    x = multisine(2011, rms=0.2, lines=lines, axes=2, periods=6, phases="random", seed=seed)
    x = x[: rng.integers(4100, 12000)]
    assert find_period(x) == 2011
    noisy = find_period(x + rng.normal(0, 0.05, x.shape), tolerance=0.6)
    assert abs(noisy - 2011) <= (12 if lines[-1] < 20 else 1)


def test_period_common_to_different_axes():
    a = np.tile(prbs(4, amplitude=1.0)[:, 0], 40)[:600]
    b = np.tile(prbs(3, amplitude=0.1)[:, 0], 90)[:600]
    assert find_period(np.stack([a, b, np.zeros(600)], axis=1)) == 15 * 7
    assert find_period(a) == 15
    assert find_period(np.sin(2 * np.pi * np.arange(10000) / 2500)) == 2500


@pytest.mark.parametrize("seed", range(10))
def test_no_period(seed):
    rng = np.random.default_rng(seed)
    assert find_period(rng.choice([-1.0, 1.0], 5000)) is None
    assert find_period(rng.normal(size=5000).cumsum()) is None
    assert find_period(prbs(9, amplitude=1.0, periods=2)[:1000]) is None  # not quite two periods
    assert find_period(np.sin(np.linspace(0, 100, 4000) ** 2 / 10)) is None
    assert find_period(np.ones((500, 2))) is None
