"""The misfit J/dof: 1 for the exact model, with the scatter of its chi-square, and more for any model that misses."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from ambid.diagnosis import compare
from ambid.excitation import prbs
from ambid.identification import identify
from ambid.model import Model
from ambid.noise.window import DampedWindow, Window
from reference.whitening import Whitening

PERIOD = 2 * 1023


@pytest.fixture(scope="module")
def long_i_e():
    """Six periods whose lines lie so close that the noise spectrum is smooth over thirty of them."""
    return prbs(10, amplitude=0.15, hold=2, axes=4, periods=6)


@pytest.fixture(scope="module")
def records(bench, long_i_e):
    return bench.records(long_i_e, range(5), period=PERIOD)


@pytest.fixture(scope="module")
def compared(bench, records):
    """With the exact model."""
    return [compare(Model(bench.rig()), record).records[0] for record in records]


@pytest.mark.parametrize("seeds", [5, pytest.param(30, marks=pytest.mark.slow)], ids="{} seeds".format)
def test_the_exact_model_has_a_misfit_of_one(bench, long_i_e, compared, seeds, validated):
    """The mean of 30 has a standard deviation of 0.002; that of one is sqrt(2/dof), a tenth more as S is estimated.

    Its square passes these bounds by chance once in 1000.
    """
    others = range(len(compared), seeds)
    more = bench.records(long_i_e, others, period=PERIOD) if others else []
    exact = Model(bench.rig())
    misfits = np.array([own.misfit for own in (*compared, *(compare(exact, record).records[0] for record in more))])
    dof = 2 * 8 * (PERIOD // 2 - 1)
    low, high = np.sqrt(chi2.ppf([5e-4, 1.0 - 5e-4], seeds - 1) / (seeds - 1))
    validated(
        "Misfit J/dof of the right model, 5 and 30 seeds: deviation of its mean from 1",
        "records of an independent bench",
        misfits.mean() - 1.0,
        0.02,
    )
    assert low < misfits.std(ddof=1) / np.sqrt(2.0 / dof) < 1.1 * high


def test_channels_alone_have_a_misfit_of_one(compared):
    misfits = [[c.misfit for c in own.channels] for own in compared]
    assert_allclose(np.mean(misfits, axis=0), 1.0, atol=0.06)


@pytest.mark.slow
def test_a_small_lag_raises_it_although_the_fit_looks_done(bench, long_i_e, records):
    """An amplifier that lags 10 us longer than the rig says."""
    slow = replace(bench, tau_a=bench.tau_a + 10e-6)
    record = slow.records(long_i_e, [3], period=PERIOD)[0]
    exact, lagging = Model(bench.rig()), Model(slow.rig())
    assert compare(exact, record).records[0].misfit > 3.0
    assert abs(compare(lagging, record).records[0].misfit - 1.0) < 0.06
    refitted = identify(exact, record)
    assert refitted.noise_ceiling_percent["average"] - refitted.fit_percent["average"] < 0.5
    assert compare(refitted.model, record).records[0].misfit > 1.3
    assert compare(identify(exact, records[3]).model, records[3]).records[0].misfit < 1.06


def coloured(periods, seed, channels=3, beside=0.4):
    """Noise of mixed channels behind a slow lag, one period of 1000 samples and `periods` more."""
    random = np.random.default_rng(seed)
    white = random.standard_normal((1000 * (periods + 1) + 1, channels)) @ random.standard_normal((channels, channels))
    return white[1:] + beside * white[:-1]


@pytest.mark.parametrize(("beside", "bias"), [(0.0, 0.01), (0.4, 0.02)], ids=["white", "five times less at the top"])
@pytest.mark.parametrize("periods", [2, 3, 8])
def test_noise_of_mixed_channels_has_a_misfit_of_one(periods, beside, bias):
    """But for 4 standard errors of the mean, and what noise that is not flat over a third of the frequency adds."""
    window = Window(1000, periods, 1000)
    misfits = []
    for seed in range(30):
        noise = coloured(periods, seed, beside=beside)
        white = Whitening.between(noise, window).white(noise)
        assert white.shape == (2 * 499 * 3,)
        misfits.append(np.sum(white**2) / white.size)
    assert abs(np.mean(misfits) - 1.0) < bias + 4.0 * np.std(misfits) / np.sqrt(30)


def test_whitening_does_not_depend_on_units_and_hardly_on_mixing():
    """Every channel has an envelope of its own, so that mixed ones are not quite the same noise."""
    window, noise = Window(1000, 4, 1000), coloured(4, 1)
    mixed = noise @ np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 1.0]])
    own, scaled, other = (
        np.sum(Whitening.between(r, window).white(r) ** 2) for r in (noise, noise * [1.0, 1e-6, 1e3], mixed)
    )
    assert_allclose(own, scaled, rtol=1e-9)
    assert_allclose(own, other, rtol=0.03)


def test_a_repeated_residual_adds_its_own_power():
    """A line of amplitude a has a^2 n / 2 / S more than noise on both of its numbers together."""
    window, noise = Window(1000, 4, 1000), np.random.default_rng(2).standard_normal((5000, 1))
    line = 0.5 * np.cos(2.0 * np.pi * 50 * np.arange(5000) / 1000)[:, None]
    before, after = (np.sum(Whitening.between(r, window).white(r) ** 2) for r in (noise, noise + line))
    assert_allclose(after - before, 0.5**2 * 4000 / 2.0, rtol=0.25)


def test_the_window_holds_all_whole_periods_and_no_unfinished_one(run):
    cut = replace(run, i_e=run.i_e[:-7], y=run.y[:-7], i_c=run.i_c[:-7])
    window = Window.of(cut)
    assert (window.period, window.periods, window.first) == (510, 5, 0)
    assert_allclose(window.lines(cut.y), np.fft.rfft(cut.y[: 5 * 510], axis=0) / np.sqrt(5 * 510))
    assert_allclose(window.excited, 5 * np.arange(1, 255))


def test_noise_is_taken_without_the_first_period_where_two_others_remain():
    three, two = Window(100, 3), Window(100, 2)
    assert three.settled == Window(100, 2, 100)
    assert two.settled == two
    signal = np.random.default_rng(3).standard_normal(350)
    assert_allclose(three.settled.lines(signal), np.fft.rfft(signal[100:300]) / np.sqrt(200))


@pytest.mark.parametrize("most", [1, 2, 5, 9])
def test_lines_between_are_unexcited_and_evenly_spread(most):
    window = Window(40, 6)
    lines = window.between(most)
    assert np.all(lines % 6)
    assert len(lines) == len(np.unique(lines)) == min(most, 5) * 20
    gaps = np.diff(np.concatenate([[0], lines[: min(most, 5)], [6]]))
    assert gaps.max() - gaps.min() <= 1


def test_some_lines_are_those_of_the_whole_transform():
    window, signal = Window(100, 3), np.random.default_rng(4).standard_normal((300, 2, 3))
    more = np.array([4, 50, 149])
    index = np.concatenate([window.excited, more])
    found = np.concatenate([window.excited_lines(signal), window.single_lines(signal, more)])
    assert_allclose(found, window.lines(signal)[index], atol=1e-12)
    assert_allclose(window.points(index), np.exp(2j * np.pi * index / 300))


def test_lines_of_a_fading_signal_are_its_transform_off_the_unit_circle():
    window = DampedWindow.like(Window(50, 4, 7), 0.02)
    signal = np.random.default_rng(3).standard_normal((300, 2))
    part, k = signal[7:207], np.arange(200)
    w = window.points(window.excited)
    assert np.allclose(np.abs(w), np.exp(0.02))
    expected = w[:, None] ** -k @ part / np.linalg.norm(np.exp(-0.02 * k))
    np.testing.assert_allclose(window.excited_lines(signal), expected, atol=1e-12)
    np.testing.assert_allclose(window.single_lines(signal, window.excited[3:5]), expected[3:5], atol=1e-12)
