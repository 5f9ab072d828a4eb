"""Noise of records without periods, held against its own halves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import ambid
from ambid import Model, Record, Rig
from ambid.noise.halves import uneven
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


def said(left, i_e):
    """What `uneven` says of a residual."""
    record = Record("run", RIG.sample_rate, RIG.axes, i_e, left[:, :1], left[:, 1:], period=None)
    return uneven(record, left, i_e)


@pytest.mark.parametrize("colour", COLOURS)
def test_even_noise_is_left_alone(colour):
    random = np.random.default_rng(0)
    spoken = [said(noise(random, 2400, colour), random.standard_normal((2400, AXES))) for _ in range(100)]
    assert sum(map(bool, spoken)) <= 1, spoken


@pytest.mark.parametrize("samples", [1000, 2400, 50_000])
def test_noise_that_doubles_halfway_is_told(samples):
    random = np.random.default_rng(1)
    for _ in range(10):
        left = noise(random, samples, "low")
        left[samples // 2 :, 1] *= 2.0
        text = said(left, random.standard_normal((samples, AXES)))
        assert text.startswith("run: the noise of i_c.A_zeta has ")
        assert 2.5 < float(text.split("has ")[1].split()[0]) < 6.5


def test_noise_that_falls_is_told_too():
    random = np.random.default_rng(2)
    left = noise(random, 3000, "white")
    left[1500:, 0] /= 2.0
    assert "the noise of y.A_zeta has 0.2" in said(left, random.standard_normal((3000, AXES)))


def test_what_follows_the_excitation_is_no_noise():
    """A model that misses the response by as much as the noise, and an excitation that doubles."""
    random = np.random.default_rng(3)
    i_e = random.standard_normal((6000, AXES))
    i_e[3000:] *= 2.0
    assert said(noise(random, 6000, "white") + np.roll(i_e, 2, axis=0), i_e) == ""


def test_a_change_that_does_not_matter_is_not_told():
    random = np.random.default_rng(4)
    left = noise(random, 100_000, "white")
    left[50_000:] *= 1.09  # 1.19 times the power, which chance never brings
    assert said(left, random.standard_normal((100_000, AXES))) == ""


def test_short_halves_are_not_judged():
    left = noise(np.random.default_rng(5), 998, "white")
    left[499:] *= 3.0
    assert said(left, np.ones((998, AXES))) == ""


def measured(seed, louder=1.0):
    """A record without periods, whose noise goes round the loop and is louder in the second half."""
    i_e = np.random.default_rng(seed).choice([-1.0, 1.0], (3000, AXES))
    first, second = (
        MODEL.virtual_experiment(i_e, sensor_noise=5e-8 * f, current_noise=1e-2 * f, seed=seed) for f in (1.0, louder)
    )
    later = np.arange(3000)[:, None] >= 1500
    y, i_c = (np.where(later, b, a) for a, b in ((first.y, second.y), (first.i_c, second.i_c)))
    return replace(first, y=y, i_c=i_c, period=None)


def test_every_result_says_it():
    record = measured(1, louder=2.0)
    estimate = ambid.identify(RIG, record)
    assert estimate.is_adequate
    (note,) = (own for own in estimate.notes if "times the power in the second half" in own)
    assert note in ambid.diagnose(RIG, record).notes
    comparison = ambid.compare(estimate.model, record)
    assert note in comparison.summary()
    assert note in comparison.to_json()["records"][0]["notes"]


@pytest.mark.slow
def test_even_noise_that_goes_round_the_loop_is_left_alone():
    spoken = [ambid.compare(MODEL, measured(seed)).records[0].uneven for seed in range(100)]
    assert sum(map(bool, spoken)) <= 1, spoken
    assert all(ambid.compare(MODEL, measured(seed, louder=2.0)).records[0].uneven for seed in range(20))


def test_beside_missing_physics_nothing_is_said_of_the_noise():
    record = measured(2, louder=2.0)
    wrong = MODEL.with_values({"K_i.A_zeta": 1.2 * MODEL.theta[0]})
    assert not ambid.compare(wrong, record).is_adequate
    assert ambid.compare(wrong, record).records[0].uneven == ""
