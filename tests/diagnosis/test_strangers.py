"""Machines drawn at random, on which effects once got wrong names, or others beside them."""

import pytest

from ambid import diagnose
from hidden.experiment import experiment_on
from hidden.sizes import TARGETS, find
from hidden.strangers import stranger


def diagnosed(machine, hidden, size):
    bench = stranger(machine)
    rig, train, validate, _ = experiment_on(bench, {hidden: find(hidden, TARGETS[size], bench)}, machine)
    return diagnose(rig, train, validate=validate)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "hidden"),
    [
        pytest.param(43, "seal_forces", id="six millimetres from where it was looked for"),
    ],
)
def test_a_large_effect_is_named_alone(machine, hidden):
    found = diagnosed(machine, hidden, "large")
    assert (found.verdict, found.effects) == ("explained", (hidden,)), found
    assert found.history[-1].misfit < 1.02
    assert found.history[-1].validation_misfit < 1.03


@pytest.mark.slow
def test_friction_is_told_from_a_seal_and_a_mode_by_its_shape():
    """Of what these two would leave, 1.9 % of J, all is within chance, but for a force that follows the motion."""
    assert diagnosed(43, "coulomb_friction", "clear").effects == ("coulomb_friction",)
