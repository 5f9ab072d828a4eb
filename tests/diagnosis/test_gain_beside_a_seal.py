"""One plane's gain against the other's: K_i absorbs it, until a seal acts from one plane to the other."""

from dataclasses import replace

import pytest

from ambid import diagnose
from ambid.effects import find
from hidden.experiment import experiment_on
from hidden.families import BENCHES
from hidden.sizes import sized

ALIKE = ("sensor_misalignment", "axis_cross_coupling", "coupling_stiffness", "sensor_lag")
"""Gains across axes, a stiffness on the shaft, what comes late: candidates beside them."""


@pytest.mark.slow
def test_a_seal_tells_the_gains_of_its_planes():
    """Else its two cross stiffnesses seem to differ, and none of the candidates explains."""
    names = ("loop_delay", "seal_forces", "sensor_gain_error")
    hidden = {name: sized(name, "large", "compressor") for name in names}
    bench = replace(BENCHES["compressor"], order=8)
    rig, train, validate, truth = experiment_on(bench, hidden, 2101, kind="compressor")
    catalogue = [find(name) for name in (*names, *ALIKE)]
    found = diagnose(rig, train, validate=validate, catalogue=catalogue)
    named = {*found.effects, *(name for names in found.ambiguous_sets for name in names)}
    assert named >= set(names), found
    assert found.history[-1].misfit < 1.03
    seal, own = truth.parameters["seal_forces"], {p.name: p for p in found.model.parameters}
    for name, value in (("direct_stiffness", seal["direct"]), ("cross_stiffness", seal["cross"])):
        assert own[f"seal_forces.{name}"].value == pytest.approx(value, rel=0.005), name
