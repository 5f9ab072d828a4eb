"""Two effects at once, each of which alone leaves much: both are named, beside what comes near to either."""

from dataclasses import replace

import pytest

from ambid import diagnose, prbs
from ambid.effects import find
from hidden.bench import measured
from hidden.experiment import experiment_on
from hidden.families import BENCHES
from hidden.one_axis import NAMED, ONE_AXIS
from hidden.sizes import sized

NEAR = ("sensor_misalignment", "loop_delay", "coupling_stiffness")
"""A turn, a lag and a stiffness, which share in what the pairs do."""
PAIRS = [
    ("axis_cross_coupling", "eddy_currents"),
    ("seal_forces", "eddy_currents"),
    ("sensor_position_error", "bending_mode_shift"),
]


def test_of_one_axis():
    pair = ("loop_delay", "external_damping")
    i_e = prbs(7, amplitude=0.2, hold=4, periods=4)
    record = measured(ONE_AXIS.rig, i_e, {name: NAMED[name] for name in pair}, seed=1, **ONE_AXIS.truth)
    found = diagnose(ONE_AXIS.rig, record, catalogue=[find(name) for name in (*pair, "back_emf")])
    assert (found.verdict, set(found.effects)) == ("explained", set(pair)), found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
def test_of_four_axes(pair):
    own = replace(BENCHES["bench"], order=7)
    rig, train, validate, truth = experiment_on(own, {name: sized(name, "large") for name in pair}, 1)
    found = diagnose(rig, train, validate=validate, catalogue=[find(name) for name in (*pair, *NEAR)])
    assert (found.verdict, set(found.effects)) == ("explained", set(pair)), found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.06)
    values = [found.parameters[f"K_i.{axis}"].value for axis in rig.axes]
    assert values == pytest.approx(truth.K_i, rel=0.01)
