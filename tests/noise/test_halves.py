"""Noise of records without periods, held against its own halves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import ambid
from ambid import Model, Record, Rig
from ambid.noise.halves import UNEVEN, uneven
from places import LEVITATOR

RIG = Rig.load(LEVITATOR)
MODEL = Model(RIG)
COLOURS = {
    "white": ([1.0], [1.0]),
    "low": ([1.0], [1.0, -0.97]),
    "resonant": ([1.0], [1.0, -2.0 * 0.995 * np.cos(0.3), 0.995**2]),
}
AXES = 1


def noise(random, samples, colour, channels=2):
    return lfilter(*COLOURS[colour], random.standard_normal((samples + 2000, channels)), axis=0)[2000:]


def found(left, i_e):
    """What `uneven` finds in a residual."""
    record = Record("run", RIG.sample_rate, RIG.axes, i_e, left[:, :1], left[:, 1:], period=None)
    return uneven(record, left, i_e)


@pytest.mark.parametrize("colour", COLOURS)
def test_even_noise_is_left_alone(colour):
    random = np.random.default_rng(0)
    shown = [found(noise(random, 2400, colour), random.standard_normal((2400, AXES))) for _ in range(100)]
    assert sum(map(bool, shown)) <= 1, shown


@pytest.mark.parametrize("samples", [1000, 2400, 50_000])
def test_noise_that_doubles_halfway_is_told(samples):
    random = np.random.default_rng(1)
    for _ in range(10):
        left = noise(random, samples, "low")
        left[samples // 2 :, 1] *= 2.0
        shown = found(left, random.standard_normal((samples, AXES)))
        assert (shown.code, shown.where.record, shown.where.channel) == ("noise_not_stationary", "run", "i_c.A_zeta")
        assert 2.5 < shown.values["ratio"] < 6.5


def test_noise_that_falls_is_told_too():
    random = np.random.default_rng(2)
    left = noise(random, 3000, "white")
    left[1500:, 0] /= 2.0
    shown = found(left, random.standard_normal((3000, AXES)))
    assert shown.where.channel == "y.A_zeta"
    assert shown.values["ratio"] == pytest.approx(0.25, abs=0.05)


def test_what_follows_the_excitation_is_no_noise():
    """A model that misses the response by as much as the noise, and an excitation that doubles."""
    random = np.random.default_rng(3)
    i_e = random.standard_normal((6000, AXES))
    i_e[3000:] *= 2.0
    assert found(noise(random, 6000, "white") + np.roll(i_e, 2, axis=0), i_e) is None


def test_a_change_that_does_not_matter_is_not_told():
    random = np.random.default_rng(4)
    left = noise(random, 100_000, "white")
    left[50_000:] *= 1.09  # 1.19 times the power, which chance never brings
    assert found(left, random.standard_normal((100_000, AXES))) is None


def test_short_halves_are_not_judged():
    left = noise(np.random.default_rng(5), 998, "white")
    left[499:] *= 3.0
    assert found(left, np.ones((998, AXES))) is None


def measured(seed, louder=1.0):
    """A record without periods, whose noise goes round the loop and is louder in the second half."""
    i_e = np.random.default_rng(seed).choice([-1.0, 1.0], (3000, AXES))
    first, second = (
        MODEL.virtual_experiment(i_e, sensor_noise=5e-8 * f, current_noise=1e-2 * f, seed=seed) for f in (1.0, louder)
    )
    later = np.arange(3000)[:, None] >= 1500
    y, i_c = (np.where(later, b, a) for a, b in ((first.y, second.y), (first.i_c, second.i_c)))
    return replace(first, y=y, i_c=i_c, period=None)


def of_halves(result):
    """Channel and ratio of each finding of the kind."""
    return [(own.where.channel, own.values["ratio"]) for own in result.findings if own.kind is UNEVEN]


def test_every_result_has_it():
    record = measured(1, louder=2.0)
    estimate = ambid.identify(RIG, record)
    assert estimate.is_adequate
    shown = of_halves(estimate)
    assert shown == of_halves(ambid.diagnose(RIG, record))
    comparison = ambid.compare(estimate.model, record)
    assert comparison.records[0].notes[-1] in comparison.summary()
    codes = [own["code"] for own in comparison.to_json()["records"][0]["findings"]]
    assert codes.count("noise_not_stationary") == len(shown) == 1


@pytest.mark.slow
def test_even_noise_that_goes_round_the_loop_is_left_alone():
    shown = [of_halves(ambid.compare(MODEL, measured(seed))) for seed in range(60)]
    assert sum(map(bool, shown)) <= 1, shown
    assert all(of_halves(ambid.compare(MODEL, measured(seed, louder=2.0))) for seed in range(10))


def test_beside_missing_physics_nothing_is_said_of_the_noise():
    record = measured(2, louder=2.0)
    wrong = MODEL.with_values({"K_i.A_zeta": 1.2 * MODEL.theta[0]})
    assert not ambid.compare(wrong, record).is_adequate
    assert not of_halves(ambid.compare(wrong, record))
