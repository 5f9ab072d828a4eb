"""Several operating points that share all but one number: what is missing is named, and what changes is reported."""

from dataclasses import replace

import pytest

from ambid.diagnosis import diagnose
from ambid.effects import find
from hidden.bench import measured
from hidden.one_axis import NAMELESS, ONE_AXIS

DELAY = {"loop_delay": {"seconds": 5e-5}}
FEW = [find(name) for name in ("loop_delay", "sensor_lag", "amplifier_bandwidth", "force_nonlinearity")]


def at_two_points(hidden, tau_e, bench=ONE_AXIS):
    """A record at each of two bias currents, whose lags are these."""
    first = bench.rig.bearings[0].bias_current
    found = []
    for seed, (share, lag) in enumerate(zip((1.0, 0.9), tau_e, strict=True)):
        bearing = bench.rig.bearings[0].model_copy(update={"bias_current": share * first})
        rig = bench.rig.replace(name=f"{share} of the bias", bearings=(bearing,))
        truth = {**bench.truth, "K_i": share * 185.0, "K_s": share**2 * 1.18e6, "tau_e": lag}
        found.append(measured(rig, bench.excitation(1.0), hidden, seed=seed, **truth).at(rig))
    return found


@pytest.mark.slow
def test_what_changes_between_points_is_told_beside_what_is_missing():
    records = at_two_points(DELAY, (2.85e-4, 3.1e-4))
    found = diagnose(records[0].point, records, catalogue=FEW)
    assert found.verdict == "explained", found
    assert found.effects == ("loop_delay",)
    assert not found.fit.is_adequate
    (shown,) = (own.values for own in found.findings if own.code == "changes_with_operating_point")
    assert shown["parameter"] == "tau_e"
    assert (shown["least"], shown["most"]) == (pytest.approx(2.85e-4, rel=0.02), pytest.approx(3.1e-4, rel=0.02))
    assert (found.next_step.code, found.next_step.values["parameter"]) == ("next_find_what_changes", "tau_e")


@pytest.mark.slow
def test_points_that_share_everything_are_told_nothing():
    records = at_two_points(DELAY, (2.85e-4, 2.85e-4))
    found = diagnose(records[0].point, records, catalogue=FEW)
    assert found.verdict == "explained", found
    assert found.fit.is_adequate
    assert "changes_with_operating_point" not in {own.code for own in found.findings}


@pytest.mark.slow
def test_what_has_no_name_at_any_point_stays_nameless():
    hidden = {"amplifier_asymmetry": NAMELESS["amplifier_asymmetry"]}
    records = at_two_points(hidden, (2.85e-4, 3.1e-4), replace(ONE_AXIS, order=7))
    assert diagnose(records[0].point, records, catalogue=FEW).verdict == "none_of_the_candidates"
