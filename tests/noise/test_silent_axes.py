"""Axes that nothing drives: they take nothing of the noise of the others."""

from dataclasses import replace

import numpy as np

import ambid
from ambid import Model, Rig
from ambid.noise.local import beside_excitation
from places import BENCH


def test_silent_axes_leave_the_power_of_the_noise_as_it_is():
    """A regression on them would take whole lines, as many as it has numbers, and leave zero."""
    random = np.random.default_rng(1)
    lines, excitation = (random.normal(size=(300, 4)) + 1j * random.normal(size=(300, 4)) for _ in range(2))
    excitation[:, :3] = 0.0
    [found] = beside_excitation([lines], excitation)
    [alone] = beside_excitation([lines], excitation[:, 3:])
    assert found.power.min() > 0.0
    assert np.array_equal(found.spectrum, alone.spectrum)
    assert np.array_equal(found.power, alone.power)
    assert found.spread == alone.spread


def test_one_axis_driven_without_periods():
    """The halves of its record have noise of one power, and the model is right."""
    model = Model(Rig.load(BENCH))
    i_e = np.zeros((6000, 4))
    i_e[:, 3] = np.random.default_rng(2).normal(size=6000)
    record = replace(model.virtual_experiment(i_e, seed=3), period=None)
    comparison = ambid.compare(model, record)
    assert comparison.is_adequate
    assert not any("nan" in note for note in comparison.notes)
