"""What the formula of an effect is known to leave gives no other effect its name."""

import pytest

from ambid import diagnose
from ambid.effects import find
from ambid.excitation import prbs
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS

HYSTERESIS = {"magnetic_hysteresis": {"share": 0.12, "width": 0.15}}
"""Of plays in parallel; the product's law is another one."""


FEW = [find(name) for name in ("magnetic_hysteresis", "sensor_lag", "loop_delay", "eddy_currents")]


def of_plays(more, seed):
    i_e = prbs(9, amplitude=1.0, hold=4, periods=8, seed=seed)
    return measured(ONE_AXIS.rig, i_e, HYSTERESIS | more, seed=seed, **ONE_AXIS.truth)


@pytest.mark.slow
def test_another_law_of_hysteresis_is_hysteresis_alone():
    laws = [find(name) for name in ("force_nonlinearity", "flux_saturation", "amplifier_bandwidth")]
    found = diagnose(ONE_AXIS.rig, of_plays({}, 1), validate=of_plays({}, 2), catalogue=FEW + laws)
    assert (found.verdict, found.effects) == ("explained", ("magnetic_hysteresis",)), found
    assert found.history[0].misfit > 2.0
    assert found.history[-1].misfit < found.history[0].misfit


@pytest.mark.slow
def test_what_is_more_than_that_is_still_named():
    lag = {"sensor_lag": {"tau": 6e-5}}
    found = diagnose(ONE_AXIS.rig, of_plays(lag, 1), validate=of_plays(lag, 2), catalogue=FEW)
    named = {*found.effects, *(name for names in found.ambiguous_sets for name in names)}
    assert {"magnetic_hysteresis", "sensor_lag"} <= named, found
