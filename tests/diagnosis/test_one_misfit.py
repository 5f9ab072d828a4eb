"""One model and one record have one misfit, whoever states it."""

import pytest

import ambid
from ambid.effects import find
from hidden.experiment import experiment
from hidden.one_axis import ONE_AXIS, record
from tiers import first_fast


@pytest.mark.parametrize("effect", first_fast(["loop_delay", "seal_forces"]))
def test_identify_compare_rank_and_diagnose_state_one_misfit(effect, tmp_path):
    if effect == "loop_delay":
        rig, train = ONE_AXIS.rig, record({effect: {"seconds": 5e-5}}, 11)
    else:
        rig, train, _, _ = experiment(effect, "large", 11, kind="compressor")
    estimate = ambid.identify(rig, train)
    estimate.model.save(tmp_path / "model.json")
    model = ambid.Model.load(tmp_path / "model.json")
    comparison = ambid.compare(model, train)
    assert comparison.misfit == pytest.approx(estimate.misfit, rel=1e-12)
    assert ambid.rank(comparison).misfit == comparison.misfit
    found = ambid.diagnose(model, train, catalogue=[find("loop_delay"), find("seal_forces")])
    again = ambid.identify(model, train)  # a diagnosis fits the model once more
    assert found.history[0].misfit == pytest.approx(again.misfit, rel=1e-12)
    assert again.misfit == pytest.approx(comparison.misfit, rel=1e-3)
    for result, misfit, bound in (
        (again.to_json(), again.misfit, again.misfit_bound),
        (comparison.to_json(), comparison.misfit, comparison.bound),
        (found.to_json(), found.fit.misfit, found.fit.bound),
    ):
        (own,) = (test for test in result["adequacy"] if test["test"] == "misfit")
        assert (own["statistic"], own["limit"]) == (misfit, bound)
