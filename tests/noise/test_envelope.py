"""The envelope of noise: that of the colour it has, and none where it has none."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ambid.noise.envelope import HIGHEST, Envelope
from ambid.noise.whitener import between_lines
from ambid.noise.window import Window
from reference.whitening import Whitening

SAMPLES = 4096
ANGLE = np.pi * np.arange(1, SAMPLES // 2) / (SAMPLES // 2)
FIRST_ORDER = [1.0], [1.0, -0.9]
RESONANT = [1.0], [1.0, -2.0 * 0.98 * np.cos(0.7), 0.98**2]


def noise(colour, samples=SAMPLES, seed=0, channels=3):
    white = np.random.default_rng(seed).standard_normal((samples + 1000, channels))
    return lfilter(*colour, white, axis=0)[1000:]


def power(signal):
    return np.abs(np.fft.rfft(signal, axis=0)[1 : len(signal) // 2]) ** 2 / len(signal)


@pytest.mark.parametrize("colour", [FIRST_ORDER, RESONANT], ids=["first order", "resonant"])
def test_it_is_the_spectrum_of_autoregressive_noise(colour):
    """Within four standard errors of some 2000 lines, wherever the spectrum is, over 30 dB."""
    envelope = Envelope(power(noise(colour)), ANGLE)
    numerator, denominator = colour
    true = np.abs(np.polyval(numerator[::-1], np.exp(-1j * ANGLE)) / np.polyval(denominator[::-1], np.exp(-1j * ANGLE)))
    assert len(denominator) - 1 <= envelope.orders.min()
    assert envelope.orders.max() < HIGHEST // 2
    assert np.abs(np.log(envelope.root(ANGLE) / true[:, None])).max() < 0.35


def test_white_noise_has_none():
    """Schwarz's criterion takes a coefficient that is not there in about 1 of 200 records of this length."""
    orders = [Envelope(power(noise(([1.0], [1.0]), seed=seed)), ANGLE).orders for seed in range(50)]
    assert np.mean(np.array(orders) > 0) < 0.05


def test_channels_scale_as_their_powers():
    signal = noise(FIRST_ORDER)
    own, scaled = Envelope(power(signal), ANGLE), Envelope(power(signal * [1.0, 1e-6, 1e3]), ANGLE)
    assert (own.orders == scaled.orders).all()
    np.testing.assert_allclose(scaled.root(ANGLE) / own.root(ANGLE), np.tile([1.0, 1e-6, 1e3], (len(ANGLE), 1)))


@pytest.mark.parametrize("band", [slice(0, 6), slice(6, 20), slice(20, None)], ids=["lowest", "corner", "above"])
def test_noise_that_changes_within_a_few_lines_has_a_misfit_of_one_everywhere(band):
    """A corner at the third of 63 lines: the mean over thirty of them is a fifth of what the lowest hold."""
    window = Window(127, 8, 127)
    misfits = []
    for seed in range(40):
        signal = noise(FIRST_ORDER, 127 * 9, seed, channels=8)
        lines = Whitening.between(signal, window).white(signal).reshape(-1, 16)
        misfits.append(np.mean(lines[band] ** 2))
    assert abs(np.mean(misfits) - 1.0) < 0.06 + 4.0 * np.std(misfits) / np.sqrt(40)


def test_a_covariance_scales_as_the_lines():
    lines = np.ascontiguousarray(np.fft.rfft(noise(FIRST_ORDER), axis=0)[1:2000])
    at = np.arange(1.0, 2000.0) / 4.0
    own, _ = between_lines(lines, at, at[::4])
    turned, _ = between_lines(2.0 * lines, at, at[::4])
    np.testing.assert_allclose(turned, 4.0 * own)


def test_it_says_how_sure_it_is():
    """The scatter of the logarithm over records, at the peak; beside it a short record leaks, and scatters more."""
    random = [Envelope(power(noise(RESONANT, 256, seed, 1)), np.pi * np.arange(1, 128) / 128) for seed in range(200)]
    known = [envelope for envelope in random if envelope.orders[0] == 2]
    assert len(known) > 100
    at = np.array([0.3, 0.7, 1.5])
    scatter = np.var([2.0 * np.log(envelope.root(at)[:, 0]) for envelope in known], axis=0)
    shown = np.mean([envelope.variance(at)[:, 0] for envelope in known], axis=0)
    assert np.sqrt(scatter[1] / shown[1]) == pytest.approx(1.0, abs=0.25)
    assert shown[1] > 3.0 * shown[[0, 2]].max()
    assert (np.sqrt(scatter / shown) < 2.5).all()


def test_a_spectrum_of_sixteen_decades_has_a_finite_one():
    """Rounding leaves the recursion a negative power there, unless it ends before."""
    root = Envelope(1.0 / (1e-16 + np.sin(ANGLE / 2.0)[:, None] ** 32), ANGLE).root(ANGLE)
    assert np.isfinite(root).all()
    assert (root > 0.0).all()
