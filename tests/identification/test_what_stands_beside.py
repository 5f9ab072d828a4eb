"""Intervals hold no value that physics excludes, and the places of effects stand beside their values."""

import numpy as np
import pytest

from ambid import Model, ParameterEstimate, Rig, identify
from ambid.effects.support import SealForces
from ambid.model import Parameter
from hidden.bench import simulate
from hidden.one_axis import ONE_AXIS
from places import BENCH


@pytest.mark.parametrize(
    ("lower", "upper", "value", "interval"),
    [
        (5e-9, np.inf, 6e-9, (0.0, 6e-9 + 1.96e-4)),
        (-np.inf, 0.0, -6e-9, (-6e-9 - 1.96e-4, 0.0)),
        (-np.inf, np.inf, 6e-9, (6e-9 - 1.96e-4, 6e-9 + 1.96e-4)),
        (0.0, np.inf, 1e-3, (1e-3 - 1.96e-4, 1e-3 + 1.96e-4)),
    ],
)
def test_an_interval_keeps_the_sign_of_its_parameter(lower, upper, value, interval):
    parameter = Parameter("tau_e", value, "s", ("tau_e",), lower, upper)
    found = ParameterEstimate.of(parameter, 1e-4, 5e-5)
    assert found.ci95 == pytest.approx(interval, rel=1e-4, abs=1e-12)
    assert (found.std_error, found.std_error_statistical) == (1e-4, 5e-5)


def test_a_lag_that_is_none_has_no_negative_limit():
    i_e = ONE_AXIS.excitation(0.02 * ONE_AXIS.amplitude)
    record = simulate(ONE_AXIS.rig, i_e, seed=3, period=ONE_AXIS.period, **(ONE_AXIS.truth | {"tau_e": 1e-9}))
    found = identify(ONE_AXIS.rig, record)["tau_e"]
    assert found.value < 1.96 * found.std_error
    assert found.ci95[0] == 0.0


def test_settings_of_effects_stand_beside_their_values():
    model = Model(Rig.load(BENCH)).add(SealForces(z=0.47))
    (effect,) = model.effects
    assert effect.fine_settings() == {"seal_forces.z": (0.47, "m")}
