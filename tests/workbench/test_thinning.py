"""No peak is lost, however long the signal and wherever the peak."""

import numpy as np
import pytest

from ambid.workbench.views import thinned


def in_a_row(count, pixels):
    """The pixels of so many samples, evenly spread over a chart."""
    return np.arange(count) * pixels // count


@pytest.mark.parametrize("at", [0, 1, 499_999, 999_998, 999_999])
def test_a_single_sample_of_a_million_is_drawn(at):
    signal = np.random.default_rng(at).standard_normal((1_000_000, 1))
    signal[at] = 50.0
    kept = thinned(signal, in_a_row(len(signal), 1000))
    assert at in kept
    assert len(kept) <= 2 * 1000 + 2


def test_every_pixel_keeps_its_smallest_and_largest_value_of_each_signal():
    signals = np.random.default_rng(1).standard_normal((10_000, 2))
    kept = thinned(signals, in_a_row(10_000, 100))
    for pixel in range(100):
        own = slice(100 * pixel, 100 * pixel + 100)
        inside = kept[(kept >= own.start) & (kept < own.stop)]
        np.testing.assert_array_equal(signals[inside].max(axis=0), signals[own].max(axis=0))
        np.testing.assert_array_equal(signals[inside].min(axis=0), signals[own].min(axis=0))


def test_a_short_signal_is_drawn_whole():
    np.testing.assert_array_equal(thinned(np.ones((40, 3)), in_a_row(40, 50)), np.arange(40))


def test_a_clipped_signal_is_thinned_too():
    assert len(thinned(np.ones((100_000, 1)), in_a_row(100_000, 100))) <= 102


def test_gaps_hide_nothing_beside_them():
    signal = np.full((5000, 1), np.nan)
    signal[1234] = 1.0
    assert 1234 in thinned(signal, in_a_row(5000, 50))
