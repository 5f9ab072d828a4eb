"""Excitations against their closed forms."""

import numpy as np
import pytest

from ambid.errors import InputError
from ambid.excitation import multisine, prbs
from ambid.record.repeats import find_period


@pytest.mark.parametrize("order", range(2, 17))
def test_prbs_is_a_maximum_length_sequence(order):
    length = 2**order - 1
    chips = prbs(order, amplitude=1.0, seed=order)[:, 0]
    assert chips.shape == (length,)
    assert abs(chips.sum()) == 1  # balance
    correlation = np.fft.irfft(np.abs(np.fft.rfft(chips)) ** 2, n=length) / length
    np.testing.assert_allclose(correlation, np.r_[1.0, np.full(length - 1, -1 / length)], atol=1e-11)


@pytest.mark.parametrize("order", [5, 9, 12])
def test_prbs_run_lengths(order):
    """Of 2^(n-1) runs, one in 2^k has length k; the two longest have n and n - 1 (Golomb's second postulate)."""
    chips = prbs(order, amplitude=1.0)[:, 0]
    chips = np.roll(chips, -np.flatnonzero(np.diff(chips))[0] - 1)
    runs = np.diff(np.r_[0, np.flatnonzero(np.diff(chips)) + 1, chips.size])
    expected = {k: 2 ** (order - 1 - k) for k in range(1, order - 1)} | {order - 1: 1, order: 1}
    assert {int(k): int(np.sum(runs == k)) for k in np.unique(runs)} == expected


def test_prbs_long_orders_have_their_length():
    assert prbs(20, amplitude=1.0).shape == (2**20 - 1, 1)
    assert find_period(prbs(17, amplitude=1.0, periods=2)) == 2**17 - 1


def test_prbs_shifts_holds_and_repeats():
    x = prbs(6, amplitude=0.3, hold=3, axes=4, periods=2, seed=5)
    assert x.shape == (2 * 63 * 3, 4)
    assert set(np.unique(x)) == {-0.3, 0.3}
    np.testing.assert_array_equal(x[:189], x[189:])
    np.testing.assert_array_equal(x[::3], x[2::3])
    for axis in range(4):
        np.testing.assert_array_equal(x[:189, axis], np.roll(x[:189, 0], 3 * (axis * 63 // 4)))
    np.testing.assert_array_equal(x, prbs(6, amplitude=0.3, hold=3, axes=4, periods=2, seed=5))
    shifted = prbs(6, amplitude=1.0, axes=2, shifts=[0, 10])
    np.testing.assert_array_equal(shifted[:, 1], np.roll(shifted[:, 0], 10))


WRONG_PRBS = (
    {"order": 1},
    {"order": 25},
    {"order": 7.0},
    {"amplitude": 0.0},
    {"amplitude": np.nan},
    {"hold": 0},
    {"axes": 0},
    {"periods": -1},
    {"axes": 2, "shifts": [1]},
    {"axes": 2, "shifts": [0.5, 1.5]},
    {"axes": 2, "shifts": [0, 127]},
    {"order": 2, "axes": 4},
)


@pytest.mark.parametrize("arguments", WRONG_PRBS, ids=str)
def test_prbs_refuses(arguments, golden):
    with golden.raises(InputError):
        prbs(**{"order": 7, "amplitude": 1.0} | arguments)


@pytest.mark.parametrize("phases", ["schroeder", "random", "clipped"])
@pytest.mark.parametrize("period", [1000, 1001])
def test_multisine_has_power_on_its_lines_only(period, phases):
    lines = [3, 7, 8, 20, 111, 400]
    x = multisine(period, rms=0.2, lines=lines, axes=2, periods=3, phases=phases, seed=2)
    assert x.shape == (3 * period, 2)
    np.testing.assert_allclose(np.sqrt(np.mean(x**2, axis=0)), 0.2, rtol=1e-12)
    spectrum = np.abs(np.fft.rfft(x[:period], axis=0)) / period
    for axis in range(2):
        own = lines[axis::2]
        np.testing.assert_allclose(spectrum[own, axis], 0.2 * np.sqrt(2 / len(own)) / 2, rtol=1e-10)
        assert np.delete(spectrum[:, axis], own).max() < 1e-14


def test_multisine_band_and_crest_factor():
    x = multisine(10000, rms=1.0, band_hz=(10.0, 500.0), sample_rate=10000.0)[:, 0]
    excited = np.flatnonzero(np.abs(np.fft.rfft(x)) > 1e-6)
    np.testing.assert_array_equal(excited, np.arange(10, 501))
    assert np.abs(x).max() < 2.0  # rms is 1; random phases reach about 3.5
    random = multisine(10000, rms=1.0, band_hz=(10.0, 500.0), sample_rate=10000.0, phases="random")
    assert np.abs(random).max() > 2.5


def test_multisine_has_the_powers_that_are_asked_for():
    lines, powers = [40, 7, 8, 111], [3.0, 1.0, 0.5, 2.0]
    x = multisine(1000, rms=0.3, lines=lines, powers=powers)[:, 0]
    found = np.abs(np.fft.rfft(x))[lines] ** 2
    np.testing.assert_allclose(found / found.sum(), np.array(powers) / 6.5, rtol=1e-10)
    np.testing.assert_allclose(x.std(), 0.3, rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_clipping_lowers_the_peak_and_keeps_the_powers(seed):
    powers = np.random.default_rng(seed).uniform(0.1, 1.0, 300)
    settings = {"rms": 1.0, "lines": list(range(5, 305)), "powers": powers}
    before = multisine(2000, **settings, phases="schroeder")[:, 0]
    after = multisine(2000, **settings, phases="clipped")[:, 0]
    np.testing.assert_allclose(np.abs(np.fft.rfft(after)), np.abs(np.fft.rfft(before)), atol=1e-9)
    assert np.abs(after).max() < 1.55 < 1.8 < np.abs(before).max()


WRONG_MULTISINE = (
    {"powers": [1.0]},
    {"powers": [1.0, 0.0]},
    {"powers": [1.0, 1.0], "lines": None, "band_hz": (1.0, 2.0), "sample_rate": 100.0},
    {"lines": None},
    {"band_hz": (1.0, 2.0)},
    {"lines": []},
    {"lines": [0]},
    {"lines": [50]},
    {"lines": [3, 3]},
    {"lines": [1.5]},
    {"rms": -1.0},
    {"period": 2},
    {"phases": "zero"},
    {"axes": 3},
    {"lines": None, "band_hz": (1.0, 2.0)},
    {"lines": None, "band_hz": (1.0, 600.0), "sample_rate": 1000.0},
    {"lines": None, "band_hz": (11.0, 12.0), "sample_rate": 1000.0},
)


@pytest.mark.parametrize("arguments", WRONG_MULTISINE, ids=str)
def test_multisine_refuses(arguments, golden):
    with golden.raises(InputError):
        multisine(**{"period": 100, "rms": 1.0, "lines": [1, 2]} | arguments)
