"""One machine at two bias currents has one set of errors of its rig file: fits combined are the joint fit."""

import numpy as np
import pytest

from ambid import Rig, identify, prbs
from ambid.identification import with_common_tolerances
from ambid.identification.common import common_tolerances
from hidden.tolerances import machine_off
from places import LEVITATOR

LOW = {"K_i": [165.0], "K_s": [1.1e6], "tau_e": 2.4e-4}
HIGH = {"K_i": [200.0], "K_s": [1.3e6], "tau_e": 2.4e-4}
NOISE = {"sensor_noise": 30e-9, "current_noise": 2e-3, "period": 254}
FIXED = {"tau_e": 2.4e-4}
"""The joint fit would share it, too."""


def two_points(seed):
    """Rig files and records of a machine that is off, at two bias currents."""
    off = machine_off(Rig.load(LEVITATOR), seed)
    more = [b.model_copy(update={"bias_current": b.bias_current + 1.0}) for b in off.known.bearings]
    rigs = off.known, off.known.replace(bearings=more)
    i_e = [prbs(7, amplitude=0.2, hold=2, axes=1, periods=6, seed=2 * seed + k) for k in range(2)]
    return rigs, [
        off.record(own, 2 * seed + k, **m, **NOISE) for k, (own, m) in enumerate(zip(i_e, (LOW, HIGH), strict=True))
    ]


@pytest.mark.parametrize("seed", range(3))
def test_fits_combined_are_the_joint_fit(seed):
    rigs, records = two_points(seed)
    alone = [identify(rig, record, fixed=FIXED) for rig, record in zip(rigs, records, strict=True)]
    common = with_common_tolerances(alone)
    joint = identify(rigs[0], [records[0], records[1].at(rigs[1])], fixed=FIXED)
    for estimate, end in zip(common, ("", "@5A"), strict=True):
        for name, p in estimate.parameters.items():
            own = joint.parameters[name + end]
            assert abs(p.value - own.value) < 0.1 * own.std_error
            assert p.std_error == pytest.approx(own.std_error, rel=0.01)
            assert p.std_error_statistical == pytest.approx(own.std_error_statistical, rel=0.02)
            assert sum(estimate.budget()[name].values()) == pytest.approx(p.std_error**2, rel=1e-6)
        for name, known in estimate.tolerances.items():
            assert known.posterior_value == pytest.approx(joint.tolerances[name].posterior_value, abs=0.1 * known.std)
            assert known.posterior_std == pytest.approx(joint.tolerances[name].posterior_std, rel=0.01)
        assert estimate.is_adequate


def test_they_are_no_wider_than_each_by_itself():
    rigs, records = two_points(1)
    alone = [identify(rig, record, fixed=FIXED) for rig, record in zip(rigs, records, strict=True)]
    for before, after in zip(alone, with_common_tolerances(alone), strict=True):
        assert all(after[name].std_error <= p.std_error for name, p in before.parameters.items())
        np.testing.assert_allclose(after.covariance, after.model.covariance[:2, :2])


def test_one_fit_exact_rigs_and_other_machines_stay_as_they_are():
    rigs, records = two_points(2)
    first = identify(rigs[0], records[0], fixed=FIXED)
    exact = identify(rigs[1].exact(), records[1], fixed=FIXED)
    rotor = rigs[1].rotor.model_copy(update={"mass": 1.1 * rigs[1].rotor.mass})
    other = identify(rigs[1].replace(rotor=rotor), records[1], fixed=FIXED)
    assert with_common_tolerances([first]) == (first,)
    assert with_common_tolerances([first, exact]) == (first, exact)
    assert common_tolerances([first, other]) == ()
