"""Slow ramps: a load that moves while a record is taken is no noise, and hides nothing."""

import numpy as np
import pytest

from ambid import Model, Record, compare
from ambid.diagnosis import diagnose
from ambid.excitation import prbs
from ambid.noise.chance import misfit_bound
from ambid.noise.ramp import without_ramp
from hidden.bench import simulate
from hidden.one_axis import ONE_AXIS, record

PATHS = {"ramp": lambda t: t, "there and back": lambda t: 0.5 * (1.0 - np.cos(2.0 * np.pi * t))}
KINDS = {"2 periods": 2, "3 periods": 3, "6 periods": 6, "no period": None}
TRUTH = Model(ONE_AXIS.rig).with_values({"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4})


def loaded(path, size, periods, hidden=None, seed=1):
    """A record under a load that moves by so much of what 1 A makes: the loop answers it with i_c, slowly."""
    i_e = prbs(9, amplitude=1.0, hold=4, periods=periods or 4)
    if periods is None:
        i_e = np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], (len(i_e) // 4, 1)), 4, axis=0)
    load = size * PATHS[path](np.linspace(0.0, 1.0, len(i_e)))[:, None]
    found = simulate(ONE_AXIS.rig, i_e + load, hidden, seed=seed, **ONE_AXIS.truth)
    rig = ONE_AXIS.rig
    return Record.from_arrays(
        y=found.y, i_e=i_e, i_c=found.i_c - load, sample_rate=rig.sample_rate, axes=rig.axes, rig=rig
    )


def is_noise(comparison):
    """J/dof is 1 within chance, on both sides."""
    return 2.0 - misfit_bound(comparison.dof) < comparison.misfit < misfit_bound(comparison.dof)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("size", [0.1, 2.0])
@pytest.mark.parametrize("kind", KINDS)
def test_the_right_model_has_a_misfit_of_one(path, size, kind):
    found = compare(TRUTH, loaded(path, size, KINDS[kind]))
    assert is_noise(found), found.misfit
    (own,) = found.records
    assert any("a slow ramp was taken out" in note for note in own.notes)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("hidden", [None, "loop_delay", "sensor_lag", "magnetic_hysteresis"])
def test_a_record_without_a_ramp_is_left_as_it_is(kind, hidden):
    effects = {
        None: {},
        "loop_delay": {"loop_delay": {"seconds": 1e-4}},
        "sensor_lag": {"sensor_lag": {"tau": 1e-4}},
        "magnetic_hysteresis": {"magnetic_hysteresis": {"share": 0.1, "width": 0.4}},
    }
    still = loaded("ramp", 0.0, KINDS[kind], effects[hidden])
    assert without_ramp(TRUTH, still) is still


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("kind", ["3 periods", "no period"])
def test_what_is_hidden_is_found_beside_it(path, kind):
    found = diagnose(ONE_AXIS.rig, loaded(path, 0.5, KINDS[kind], {"loop_delay": {"seconds": 5e-5}}))
    assert found.effects == ("loop_delay",), found
    assert is_noise(found.fit)
    assert found.parameters["loop_delay.delay"].value == pytest.approx(5e-5, rel=0.1)
    assert any("a slow ramp was taken out" in note for note in found.notes)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("kind", ["3 periods", "no period"])
def test_nothing_hidden_beside_it_is_adequate(path, kind):
    found = diagnose(ONE_AXIS.rig, loaded(path, 0.5, KINDS[kind]))
    assert found.verdict == "adequate", found


def test_a_gain_that_drifts_is_still_seen():
    one = record({"force_current_drift": {"fraction": 0.15}}, 1)
    assert without_ramp(TRUTH, one) is one
