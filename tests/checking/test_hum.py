"""A hum that joins the current of a record without periods is no wrong gain of the controller."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import check
from hidden.bench import simulate
from hidden.families import BENCHES

BENCH = BENCHES["bench"]


def record(hum, seed=1):
    i_e = 0.7 * np.repeat(np.random.default_rng(seed).standard_normal((1500, 4)), 4, axis=0)
    hidden = {"periodic_disturbance": {"frequency_hz": 50.0, "amplitude": hum, "port": "current"}} if hum else {}
    return simulate(BENCH.rig, i_e, hidden, seed=seed, **BENCH.truth, **BENCH.noise)


def gains_off(own, rig=BENCH.rig):
    return [finding for finding in check(rig, [own]).findings if finding.where.key == "controller"]


@pytest.mark.parametrize("hum", [0.05, 0.5])
def test_a_hum_is_no_wrong_gain(hum):
    assert not gains_off(record(hum))


def test_a_wrong_gain_is_still_seen_beside_it():
    own = BENCH.rig.controller
    other = BENCH.rig.replace(controller=own.model_copy(update={"derivative": 1.3 * np.asarray(own.derivative)}))
    for hum in (0.0, 0.5):
        (finding,) = gains_off(record(hum), other)
        assert finding.values["factors"]["derivative"] == pytest.approx(1.0 / 1.3, rel=0.05)


def test_a_sine_of_the_excitation_is_kept():
    """It stands alone on its line, too, but the machine answers it by the controller's equation."""
    time = np.arange(6000) / BENCH.rig.sample_rate
    sines = [np.sin(2.0 * np.pi * f * time) for f in (31.7, 83.1, 150.3, 333.3)]
    i_e = 0.5 * np.stack(sines, axis=1) + 0.2 * np.random.default_rng(0).standard_normal((6000, 4))
    own = simulate(BENCH.rig, i_e, {}, seed=2, **BENCH.truth, **BENCH.noise)
    assert not gains_off(own)
    pid = BENCH.rig.controller
    other = BENCH.rig.replace(controller=pid.model_copy(update={"proportional": 1.3 * np.asarray(pid.proportional)}))
    assert gains_off(replace(own), other)
