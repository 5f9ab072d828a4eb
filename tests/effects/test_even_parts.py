"""Effects with an even part: magnets that differ, and readings that are bent."""

import numpy as np
import pytest

import ambid
from hidden.bench import simulate
from hidden.one_axis import ONE_AXIS, record

RIG = ONE_AXIS.rig
BENT = {"quadratic": 300.0, "cubic": 3e6}


def at_truth():
    return ambid.Model(RIG).with_values(
        {"K_i.A_zeta": ONE_AXIS.K_i[0], "K_s.A_zeta": ONE_AXIS.K_s[0], "tau_e": ONE_AXIS.tau_e}
    )


@pytest.mark.parametrize(("bias", "strength"), [(0.01, 0.0), (0.0, 0.01), (0.01, -0.02)])
def test_the_force_of_magnets_that_differ_is_the_even_part_of_the_square_law(bias, strength):
    """With K_i and K_s of the machine, not those of the rig file."""
    model = at_truth().add("bias_asymmetry", {"bias": bias, "strength": strength})
    found = model.watching(["f", "i_f", "s"]).simulate(model.theta, ONE_AXIS.excitation(0.05))
    f, i, s = found[:, 2:5].T
    (k_i,), (k_s,), i_0 = ONE_AXIS.K_i, ONE_AXIS.K_s, RIG.bearings[0].bias_current

    def law(u, x):
        pull = (1.0 + strength) * ((1.0 + bias + u) / (1.0 - x)) ** 2
        push = (1.0 - strength) * ((1.0 - bias - u) / (1.0 + x)) ** 2
        return 0.25 * k_i * i_0 * (pull - push)

    u, x = i / i_0, s * k_s / (i_0 * k_i)
    even = 0.5 * (law(u, x) + law(-u, -x)) - law(0.0, 0.0)
    beyond = f - k_i * i - k_s * s
    assert np.abs(beyond - even).max() < 1e-3 * np.abs(even).max()  # a^2 of K_s is more


def test_a_reading_that_is_bent_is_the_physics_that_it_says():
    i_e = ONE_AXIS.excitation(ONE_AXIS.amplitude)
    truth = simulate(RIG, i_e, {"sensor_nonlinearity": BENT}, seed=None, **ONE_AXIS.truth)
    found = at_truth().add("sensor_nonlinearity", BENT).simulate(i_e)
    assert np.abs(found.y - truth.y).max() < 1e-6 * np.abs(truth.y).max()


@pytest.mark.slow
def test_a_reading_that_is_bent_is_named():
    hidden = {"sensor_nonlinearity": BENT}
    found = ambid.diagnose(RIG, record(hidden, 1), validate=[record(hidden, 2, share=0.8)])
    assert (found.verdict, found.effects) == ("explained", ("sensor_nonlinearity",)), found
    values = {p.name: p.value for p in found.model.parameters}
    assert values["sensor_nonlinearity.quadratic"] == pytest.approx(BENT["quadratic"], rel=0.02)
    assert values["sensor_nonlinearity.cubic"] == pytest.approx(BENT["cubic"], rel=0.02)
