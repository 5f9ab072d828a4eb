"""A model at noise level fits to the ceiling in time, too, where poles are slower than excited lines can show."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambid import Model, Rig, compare, prbs

LEVITATOR = Path(__file__).parents[1] / "data" / "levitator.toml"


def below_ceiling(effect, seed):
    """By how much the fit of y is below its ceiling [%], the right model against a noisy record."""
    random = np.random.default_rng(seed)
    model = Model(Rig.load(LEVITATOR)).add(effect)
    i_e = prbs(8, amplitude=0.2, hold=2, axes=1, periods=8, seed=seed)
    record = model.simulate(i_e)
    y, i_c = (z + 0.02 * z.std() * random.standard_normal(z.shape) for z in (record.y, record.i_c))
    found = compare(model, replace(record, y=y, i_c=i_c, period=len(i_e) // 8)).records[0].channels[0]
    return found.noise_ceiling_percent - found.fit_percent


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("effect", ["eddy_currents", "sensor_lag"])
def test_fit_is_at_the_ceiling(effect, seed):
    """The half-order lag has poles far slower than a period; excited lines alone gave a fit of -1900 %."""
    assert below_ceiling(effect, seed) < 0.3


def test_the_excited_lines_alone_do_not_tell_a_slow_transient(monkeypatch):
    monkeypatch.setattr("ambid.noise.lines.lines_beside_poles", lambda *_: np.zeros(0, dtype=np.intp))
    assert max(below_ceiling("eddy_currents", seed) for seed in range(5)) > 5.0
