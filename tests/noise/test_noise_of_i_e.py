"""Noise in i_e: that which drives the loop is excitation, that of its measurement is noise of all channels at once."""

from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid import Model, Rig
from ambid.noise import Noise
from places import LEVITATOR

MODEL = Model(Rig.load(LEVITATOR))
EXCITATION = ambid.prbs(9, amplitude=1.0, hold=4, axes=1, periods=4, seed=1)
PERIOD = len(EXCITATION) // 4
NOISE = 0.01


def noise(seed):
    return NOISE * np.random.default_rng([seed, 1]).standard_normal(EXCITATION.shape)


def measured(seed):
    """The excitation repeats, and is recorded with noise."""
    record = MODEL.virtual_experiment(EXCITATION, seed=seed, current_noise=5e-3)
    return replace(record, i_e=record.i_e + noise(seed), period=PERIOD)


def driven(seed):
    """The excitation itself does not quite repeat, and is recorded as it was."""
    return replace(MODEL.virtual_experiment(EXCITATION + noise(seed), seed=seed, current_noise=5e-3), period=PERIOD)


@pytest.mark.parametrize(("made", "is_heard"), [(measured, False), (driven, True)])
def test_which_of_both_is_told_and_the_misfit_is_one(made, is_heard):
    misfits = []
    for seed in range(12):
        comparison = ambid.compare(MODEL, made(seed))
        assert comparison.noise.parts[0].unexcited.is_heard == is_heard
        misfits.append(comparison.misfit)
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.03)


def test_every_channel_is_at_its_noise_at_the_lowest_lines():
    """There the loop's answer to i_e turns from line to line, which no mean over lines around follows."""
    power = []
    for seed in range(12):
        white = ambid.compare(MODEL, measured(seed)).residual.reshape(-1, 2, 2)
        power.append(np.mean(white[4:40] ** 2, axis=(0, 2)))
    assert np.mean(power, axis=0) == pytest.approx([1.0, 1.0], abs=0.15)  # three standard deviations


def test_of_an_i_e_that_was_rebuilt_the_misfit_is_not_above_one():
    """Beside it, i_c would be judged by what it made itself: a misfit of 10 and more."""
    misfits = []
    for seed in range(8):
        record = MODEL.virtual_experiment(EXCITATION, seed=seed, current_noise=5e-3)
        own = {"y": record.y, "i_c": record.i_c, "axes": record.axes, "sample_rate": record.sample_rate}
        rebuilt = ambid.Record.from_arrays(**own, rig=MODEL.rig, period=PERIOD)
        assert rebuilt.is_rebuilt
        assert rebuilt.i_c is None
        misfits.append(ambid.compare(MODEL, rebuilt).misfit)
    assert 0.9 < np.mean(misfits) < 1.05


def test_what_repeats_to_the_last_bit_has_no_such_noise():
    record = replace(MODEL.virtual_experiment(EXCITATION, seed=1), period=PERIOD)
    unexcited = Noise(MODEL, [record]).parts[0].unexcited
    assert unexcited.is_heard
    assert unexcited.unheard(np.arange(4, 40, 4)) is None


def test_the_power_of_the_noise_is_that_of_i_e():
    unexcited = Noise(MODEL, [measured(1)]).parts[0].unexcited
    assert np.mean(unexcited.unheard(np.arange(4, 4000, 4))).real == pytest.approx(NOISE**2, rel=0.05)
