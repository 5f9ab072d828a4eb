"""A rotor that touches its touch-down bearing, against the independent simulator."""

import numpy as np
import pytest

import ambid
from ambid.effects import Seen, find, support
from ambid.effects.support import RotorContact
from effects.test_damping import BENCH, at_truth, largest_error
from hidden.bench import simulate
from hidden.one_axis import ONE_AXIS, record

STOP = {"stiffness": 3e6, "clearance": 1e-5, "damping": 10.0}
PLACES = {"magnets": (BENCH, None), "place": (BENCH, 0.43), "one axis": (ONE_AXIS, None)}


@pytest.mark.parametrize("stiffness", [3e6, 3e7])
@pytest.mark.parametrize("where", PLACES)
def test_it_is_the_physics_that_it_says(where, stiffness, monkeypatch):
    """Sharp as that of the simulator; also ten times as stiff as a magnet."""
    monkeypatch.setattr(support, "ROUNDED_TOUCH", 1e-5)
    bench, z = PLACES[where]
    i_e, stop = bench.excitation(1.0)[:300], STOP | {"stiffness": stiffness}
    expected = simulate(bench.rig, i_e, {"rotor_contact": stop | {"z": z}}, seed=None, longest_step=1e-6, **bench.truth)
    base = at_truth(bench.rig, bench)
    touching = base.add(RotorContact(z, 1e-5, 1e-2), stop).with_substeps(64)
    assert largest_error(touching.simulate(i_e), expected) < 1e-6
    assert largest_error(base.simulate(i_e), expected) > 0.05


def test_what_is_rounded_is_hardly_seen():
    i_e = ONE_AXIS.excitation(1.0)[:300]
    expected = simulate(ONE_AXIS.rig, i_e, {"rotor_contact": STOP}, seed=None, **ONE_AXIS.truth)
    base = at_truth(ONE_AXIS.rig, ONE_AXIS)
    assert largest_error(base.add(RotorContact(None, 1e-5, 1e-2), STOP).simulate(i_e), expected) < 1e-3


def test_within_the_clearance_there_is_nothing():
    base = at_truth(BENCH.rig, BENCH)
    i_e = BENCH.excitation(0.1)[:300]
    free = base.add("rotor_contact", STOP | {"clearance": 4e-5})
    assert largest_error(free.simulate(i_e), base.simulate(i_e)) < 1e-12


def test_where_it_is_tried():
    tried = find("rotor_contact").variants(Seen(BENCH.rig, {"s": 2e-5}))
    assert {own.z for own in tried} >= {None, 0.43}
    assert all(5e-6 < own.clearance < 3e-5 for own in tried)
    assert {own.z for own in find("rotor_contact").variants(Seen(ONE_AXIS.rig, {"s": 2e-5}))} == {None}


@pytest.mark.slow
def test_it_is_named_with_its_clearance():
    found = ambid.diagnose(
        ONE_AXIS.rig, record({"rotor_contact": STOP}, 1), validate=record({"rotor_contact": STOP}, 2)
    )
    assert (found.verdict, found.effects) == ("explained", ("rotor_contact",)), found
    assert found.parameters["rotor_contact.clearance"].value == pytest.approx(1e-5, rel=0.05)
    assert found.parameters["rotor_contact.stiffness"].value == pytest.approx(3e6, rel=0.1)
    assert np.isfinite(found.history[-1].misfit)
