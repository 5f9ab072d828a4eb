"""Loops whose poles all but coincide: the elimination that takes the place of modes converges on every one."""

import numpy as np
import pytest

from ambid import Model
from ambid.effects import find
from hidden.families import BENCHES

POINTS = np.exp(1j * np.linspace(0.01, 3.1, 20))


@pytest.mark.parametrize("name", list(BENCHES))
def test_four_equal_amplifiers_of_second_order(name):
    """Forty draws of K_i and K_s, against NumPy."""
    rig, random = BENCHES[name].rig, np.random.default_rng(3)
    effect = find("amplifier_bandwidth")
    model = Model(rig).add(effect, effect.probes(rig)[0])
    for _ in range(40):
        drawn = {p.name: p.value * random.uniform(0.95, 1.05) for p in model.parameters if p.name.startswith("K_")}
        own = model.with_values(drawn)
        a, b, c, d = own.loop.state_space(own.theta)
        expected = np.array([c @ np.linalg.solve(w * np.eye(len(a)) - a, b) + d for w in POINTS])
        found = own.loop.transfer(own.theta, POINTS)
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
