"""Sets of effects: without noise, and what the states of effects may do when a record begins."""

import numpy as np
import pytest
from scipy.integrate import quad

from ambid import diagnose
from ambid.diagnosis.evidence import DECADES, WITNESSES, Evidence
from hidden.bench import simulate
from hidden.dirt import MARGIN, NOISE_FREE, soiled
from hidden.families import BENCHES
from hidden.sizes import sized


@pytest.mark.slow
def test_without_any_noise_nothing_is_left():
    """Of this record the cost of the right model is zero in all digits."""
    bench = BENCHES["bench"]
    one = bench.excitation(bench.amplitude, 2)[: bench.period]
    i_e = np.take(one, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    hidden = {"seal_forces": sized("seal_forces", "clear").parameters}
    record = simulate(bench.rig, i_e, hidden, period=bench.period, seed=None, **bench.truth)
    found = diagnose(bench.rig, soiled(record, NOISE_FREE, np.random.default_rng(2), bench.rig))
    assert found.effects == ("seal_forces",)
    assert found.history[-1].misfit < 1e-8


def of(left, on_tones=0.0, waves=0):
    """A base model that leaves so much beyond the noise of 1000 numbers."""
    return Evidence(
        cost=1000.0 + left, expected=1000.0, deviation=45.0, fitted_beyond=left, formula_errors={}, beginnings=0.0,
        information=np.zeros((0, 0)), kinds=(), one_sided=0, prior=0.0, on_tones=on_tones, waves=waves,
    )  # fmt: skip


@pytest.mark.parametrize("left", [100.0, 1e3, 1e4])
def test_something_else_is_so_many_numbers_of_an_unknown_power(left):
    """Against the integral over that power, which is within three decades about what is left."""

    def likelihood(log_power):
        power = np.exp(log_power)
        cost = (WITNESSES + left) / (1.0 + power) - WITNESSES
        return np.exp(-0.5 * (cost + WITNESSES * np.log1p(power)) + shift)

    best, reach = np.log(left / WITNESSES), DECADES * np.log(10.0)
    shift = 0.5 * WITNESSES * np.log1p(left / WITNESSES)
    expected = np.log(quad(likelihood, best - reach / 2.0, best + reach / 2.0, points=[best])[0] / reach) - shift
    right = of(0.0)
    assert of(left).beside(left, right) - right.beside(0.0, right) == pytest.approx(expected, abs=0.3)


def test_a_wave_is_not_smooth():
    """What stands on lines of its own is dearer to something else than as much that is smooth, and free once named."""
    right = of(0.0, on_tones=16.0, waves=16)
    smooth, standing = of(3000.0, 16.0, 16), of(3000.0, 3016.0, 16)
    assert standing.beside(3000.0, right) != smooth.beside(3000.0, right)
    both = of(6000.0, 3016.0, 16)
    assert both.beside(6000.0, right) < min(smooth.beside(3000.0, right), standing.beside(3000.0, right)) - 20.0
    assert of(6000.0).beside(6000.0, right) > both.beside(6000.0, right) + 10.0
