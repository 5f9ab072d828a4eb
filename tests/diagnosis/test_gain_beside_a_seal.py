"""One plane's gain against the other's: K_i absorbs it, until a seal acts from one plane to the other."""

import pytest

from ambid import diagnose
from hidden.experiment import experiment


@pytest.mark.slow
def test_a_seal_tells_the_gains_of_its_planes():
    """Else its two cross stiffnesses seem to differ, J/dof is 1.12, and none of the candidates explains."""
    names = ("loop_delay", "seal_forces", "sensor_gain_error")
    rig, train, validate, truth = experiment(names, "large", 2101, kind="compressor")
    found = diagnose(rig, train, validate=validate)
    named = {*found.effects, *(name for names in found.ambiguous_sets for name in names)}
    assert named >= set(names), found
    assert found.history[-1].misfit < 1.03
    seal, own = truth.parameters["seal_forces"], {p.name: p for p in found.model.parameters}
    for name, value in (("direct_stiffness", seal["direct"]), ("cross_stiffness", seal["cross"])):
        assert own[f"seal_forces.{name}"].value == pytest.approx(value, rel=0.005), name
