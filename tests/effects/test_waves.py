"""The angle of a wave is that of what a channel holds of it, wherever the record begins."""

import numpy as np
import pytest

from ambid import Record
from ambid.effects.waves import cosine_and_sine

RATE, PERIOD = 1000.0, 200


def record(periods, place, phase, *, with_i_c):
    """A wave `place` lines from a strong excited one, alone in i_c, or, without i_c, in y."""
    samples = periods * PERIOD
    random = np.random.default_rng(periods)
    excitation = np.resize(random.standard_normal(PERIOD), samples)
    frequency = (20.0 * periods + place) * RATE / samples
    wave = 1e-2 * np.cos(2.0 * np.pi * frequency / RATE * np.arange(samples) + phase)
    hears, deaf = (excitation + wave)[:, None], (excitation + 0.1 * np.roll(excitation, 1))[:, None]
    y, i_c = (deaf, hears) if with_i_c else (hears, None)
    return frequency, Record("a wave", RATE, ("A_zeta",), excitation[:, None], y, i_c, period=PERIOD)


@pytest.mark.parametrize("with_i_c", [True, False])
@pytest.mark.parametrize("place", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("periods", [2, 3, 5])
def test_the_angle_is_that_of_the_channel_beside_any_excited_line(periods, place, with_i_c):
    for phase in (0.3, 2.0, -1.2):
        frequency, own = record(periods, place, phase, with_i_c=with_i_c)
        found = cosine_and_sine(frequency, RATE, own.samples, own, 1)
        angle = 2.0 * np.pi * frequency / RATE * np.arange(own.samples) + phase
        np.testing.assert_allclose(found, np.column_stack([np.cos(angle), np.sin(angle)]), atol=1e-7)
