"""Excited lines alone have a response: what the digits of a file leave of i_e on the others is no excitation."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ambid import prbs
from ambid.record.local_response import local_response
from ambid.record.rounding import rounding_power

RATE, PERIOD, PERIODS, HIGHEST = 8000.0, 4096, 4, 2000.0


def multisine(amplitude, seed=0):
    """Up to `HIGHEST`, a quarter of the sample rate."""
    random = np.random.default_rng(seed)
    lines = np.arange(1, int(HIGHEST / RATE * PERIOD))
    spectrum = np.zeros(PERIOD // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * random.random(len(lines)))
    x = np.fft.irfft(spectrum)
    return np.tile(amplitude * x / x.std(), PERIODS)[:, None]


def answered(u, noise=1e-9):
    random = np.random.default_rng(1)
    return 1e-6 * lfilter([0.1], [1.0, -0.9], u, axis=0) + noise * random.standard_normal(u.shape)


@pytest.mark.parametrize("step", [1e-5, 1e-4])
def test_rounding_of_an_excitation_is_none(step):
    """80 mA with two digits behind the comma: 1e-9 of the loudest line, on every line up to half the sample rate."""
    u = multisine(0.08)
    found = local_response("record", step * np.rint(u / step), answered(u), RATE, PERIOD)
    assert found.frequency_hz.max() < HIGHEST
    assert found.frequency_hz.max() > 0.9 * HIGHEST
    z = np.exp(2j * np.pi * found.frequency_hz / RATE)
    true = 1e-7 / (1.0 - 0.9 / z)
    assert np.abs(found.response[:, 0, 0] / true - 1.0).max() < 0.1


def test_levels_of_a_sequence_are_no_rounding():
    """A binary sequence is in steps, too, and of a few levels: all its lines are excitation."""
    u = prbs(12, amplitude=0.08, periods=PERIODS)
    assert rounding_power(u[:, 0]) == 0.0
    found = local_response("record", u, answered(u), RATE, len(u) // PERIODS)
    assert found.frequency_hz.max() > 0.45 * RATE
