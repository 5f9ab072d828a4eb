"""What would be left with an effect is what its refit leaves, where it is small; and what moved with it is stated."""

import json

import numpy as np
import pytest

import ambid
from ambid.diagnosis import misfit_maps
from ambid.errors import InputError
from places import LEVITATOR

RIG = ambid.Rig.load(LEVITATOR)
DELAY = [ambid.effects.find("loop_delay")]


@pytest.fixture(scope="module")
def late():
    """A mass whose controller is a little late."""
    model = ambid.Model(RIG).add("loop_delay", {"delay": 2.4e-5})
    return model.virtual_experiment(ambid.prbs(10, amplitude=0.3, hold=2, periods=4), seed=5)


@pytest.fixture(scope="module")
def ranking(late):
    return ambid.rank(ambid.identify(RIG, late).comparison, DELAY)


def test_the_residual_that_would_be_left_is_that_of_a_refit(ranking):
    shown = ambid.predict(ranking, "loop_delay")
    comparison = ranking.comparison
    (record,) = [own.record for own in comparison.records]
    refitted = ambid.identify(comparison.model.add("loop_delay"), record).model
    (now,), (left,) = misfit_maps(comparison), misfit_maps(comparison.of(refitted))
    np.testing.assert_allclose(shown.now[0].misfit, now.misfit)
    apart = np.abs(shown.then[0].misfit - left.misfit)
    assert np.nanmax(apart) < 0.5 < 5.0 < np.nanmax(now.misfit)  # two lines in the lowest band
    assert np.nanmedian(apart) < 0.02
    assert shown.misfit_now > 1.3
    assert np.nanmax(shown.part()) > 1.0
    assert shown.misfit_then == pytest.approx(comparison.of(refitted).misfit, abs=0.02)


def test_its_curves_and_sums_agree(ranking):
    shown = ambid.predict(ranking, "loop_delay")
    (candidate,) = ranking.candidates
    left = candidate.residual - candidate.size * candidate.direction
    fall = float(candidate.residual @ candidate.residual - left @ left)
    assert fall == pytest.approx(candidate.score, rel=1e-6)
    assert len(shown.curves[0][0].misfit) > len(shown.now[0].misfit)
    assert "loop_delay" in shown.lines()[0]


def test_a_name_that_is_no_candidate_is_refused(ranking, golden):
    with golden.raises(InputError):
        ambid.predict(ranking, "seal")


def test_it_is_drawn_channel_by_channel(ranking):
    panels = ambid.predict(ranking, "loop_delay").plot()
    assert [panel.get_title(loc="left") for panel in panels] == list(ranking.comparison.records[0].record.channels)
    assert len(panels[0].lines) == 3  # now, predicted, and the noise alone
    with pytest.raises(InputError, match="record = 1"):
        ambid.predict(ranking, "loop_delay").plot(record=1)


@pytest.mark.slow
def test_what_moved_is_told_with_the_last_map(late, golden):
    found = ambid.diagnose(RIG, late, catalogue=DELAY)
    base, last = found.history
    assert base.moved == ()
    (own,) = [m for m in last.moved if m.name == "tau_e"]
    assert own.before > own.after
    assert own.errors == pytest.approx((own.after - own.before) / found.parameters["tau_e"].std_error, rel=0.05)
    assert own.nominal == RIG.actuator.time_constant
    assert own.is_nearer
    golden.holds(own.line())
    assert any(own.line() in line for line in str(found).splitlines())
    (left,) = found.left
    assert np.nanmax(left.misfit) < 3.0  # two lines in the lowest band
    shown = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert shown["history"][1]["moved"][0]["parameter"] == last.moved[0].name
    assert np.shape(shown["left"][0]["misfit"]) == left.misfit.shape
