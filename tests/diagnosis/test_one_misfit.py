"""One model and one record have one misfit, whoever states it."""

import pytest

import ambid
from hidden.experiment import experiment


@pytest.mark.parametrize("effect", [None, "seal_forces"])
def test_identify_compare_rank_and_diagnose_state_one_misfit(effect, tmp_path):
    rig, train, _, _ = experiment(effect, "large", 11, kind="compressor")
    estimate = ambid.identify(rig, train)
    estimate.model.save(tmp_path / "model.json")
    model = ambid.Model.load(tmp_path / "model.json")
    comparison = ambid.compare(model, train)
    assert comparison.misfit == pytest.approx(estimate.comparison.misfit, rel=1e-9)
    assert ambid.rank(comparison).misfit == pytest.approx(comparison.misfit, rel=1e-9)
    found = ambid.diagnose(model, train)
    assert found.history[0].misfit == pytest.approx(comparison.misfit, rel=1e-3), "it is fitted once more"
