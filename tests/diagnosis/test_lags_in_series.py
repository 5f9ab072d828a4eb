"""Several lags and laws in one loop: which are added, and which of two lags is whose."""

import pytest

import ambid
from ambid.diagnosis import diagnose
from ambid.effects import find
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS
from tiers import first_fast

RIG = ONE_AXIS.rig


def record(hidden, seed, **truth):
    i_e = ambid.prbs(9, amplitude=1.0, hold=2, periods=6, seed=seed)
    return measured(RIG, i_e, hidden, seed=seed, **{**ONE_AXIS.truth, **truth})


@pytest.mark.parametrize("lag", first_fast([6e-4, 5e-5], 0))
def test_of_two_lags_in_series_the_base_model_keeps_the_one_near_its_own(lag):
    """A lag of the magnet and one of the sensor may be exchanged: J cannot show which is whose, the rig file can."""
    train = record({"sensor_lag": {"tau": lag}}, 1)
    found = diagnose(RIG, train)
    assert found.effects == ("sensor_lag",)
    values = dict(zip(found.model.names, found.model.theta, strict=True))
    assert values["sensor_lag.time_constant"] == pytest.approx(lag, rel=0.1)
    assert values["tau_e"] == pytest.approx(ONE_AXIS.tau_e, rel=0.1)
    swapped = {"sensor_lag.time_constant": values["tau_e"], "tau_e": values["sensor_lag.time_constant"]}
    here, there = (ambid.compare(found.model.with_values(own), train).misfit for own in ({}, swapped))
    assert there == pytest.approx(here, rel=1e-6)  # the record itself cannot show which


@pytest.mark.slow
def test_small_effects_beside_a_large_one_are_added_where_they_lead_to_the_noise():
    """Each is a hundredth of what the lag explains, and without them the lag would be no explanation."""
    hidden = {"sensor_lag": {"tau": 3e-4}, "back_emf": {"coefficient": 0.25}, "force_nonlinearity": {"share": 1.0}}
    few = [find(name) for name in (*hidden, "eddy_currents", "amplifier_bandwidth", "loop_delay")]
    found = diagnose(RIG, record(hidden, 2), catalogue=few)
    assert "sensor_lag" in found.effects
    assert found.verdict == "explained"
    assert found.history[-1].misfit < 1.06
    assert len(found.effects) > 1
