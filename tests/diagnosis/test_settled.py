"""A place and a frequency of an effect are moved to where the misfit is least, so that nothing else is named for it."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Model, diagnose, identify
from ambid.diagnosis.settled import placed
from ambid.effects import find
from ambid.effects.damping import CoulombFriction
from ambid.effects.support import SealForces
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY
from hidden.bench import measured
from hidden.families import BENCHES

pytestmark = pytest.mark.slow
BENCH = replace(BENCHES["small"], order=8)
"""A period of a quarter of its own: enough for what is large."""


def record(rig, hidden, seed):
    i_e = BENCH.excitation(BENCH.amplitude, seed)
    return measured(rig, i_e, hidden, seed=seed, **BENCH.truth, **BENCH.noise)


def test_a_seal_is_found_where_it_is():
    first, *_, last = sorted(bearing.position for bearing in BENCH.rig.bearings)
    z = 0.4 * first + 0.6 * last
    hidden = {"seal_forces": {"z": z, "direct": 4e5, "cross": 2e5, "damping": 200.0}}
    few = [find(name) for name in ("seal_forces", "sensor_position_error", "sensor_misalignment", "eddy_currents")]
    found = diagnose(BENCH.rig, record(BENCH.rig, hidden, 1), catalogue=few)
    assert found.effects == ("seal_forces",), found
    assert found.history[-1].misfit < 1.02
    (seal,) = found.model.effects
    assert seal.z == pytest.approx(z, abs=0.02 * (last - first))
    assert abs(found.parameters["seal_forces.direct_stiffness"].value / 4e5 - 1.0) < 0.01
    assert any("seal_forces.z" in line and f"{seal.z:.6g} m" in line for line in str(found).splitlines())


@pytest.mark.parametrize("direct", [4e4, 4e5])
def test_a_seal_that_was_fitted_elsewhere_is_asked_by_all_its_numbers(direct):
    """What it took there, of another sign or in other parts, would explain nothing where it is."""
    values = {"direct": direct, "cross": 0.5 * direct, "damping": 5e-4 * direct}
    fit = identify(BENCH.rig, record(BENCH.rig, {"seal_forces": {"z": BENCH.middle, **values}}, 3)).comparison
    places = [*BENCH.rig.rotor.span, BENCH.middle, *(bearing.position for bearing in BENCH.rig.bearings)]
    for wrong in BENCH.rig.rotor.span:
        begun = {"direct_stiffness": 1e3, "cross_stiffness": 1e3, "damping": 1.0}
        elsewhere = refit(fit.of(fit.model.add(SealForces(wrong), begun)), step=ROUGHLY)
        assert elsewhere.misfit > 10.0
        there = placed(elsewhere, elsewhere.model.effects[0], places)
        assert there.model.effects[0].z == BENCH.middle
        assert there.misfit < 1.1


def test_friction_that_was_taken_for_that_at_the_magnets_is_asked_where_it_explains_more():
    """As it is fitted there; it leaves no more than noise where it rubs, and is not moved from there."""
    hidden = {"coulomb_friction": {"force": 2.0, "z": BENCH.middle}}
    fit = identify(BENCH.rig, record(BENCH.rig, hidden, 3)).comparison
    own = CoulombFriction(width=1e-6, fastest=1e-3)
    everywhere = refit(fit.of(fit.model.add(own)), step=ROUGHLY)
    assert everywhere.misfit > 1.1
    places = [None, *BENCH.rig.rotor.span, BENCH.middle]
    there = placed(everywhere, everywhere.model.effects[0], places)
    assert there.model.effects[0].z == BENCH.middle
    assert there.misfit < 1.05
    assert placed(there, there.model.effects[0], places) is there


def test_a_place_that_a_person_gives_stays():
    first, *_, last = sorted(bearing.position for bearing in BENCH.rig.bearings)
    hidden = {"seal_forces": {"z": 0.4 * first + 0.6 * last, "direct": 4e5, "cross": 2e5, "damping": 200.0}}
    train, here = record(BENCH.rig, hidden, 1), SealForces(0.5 * first + 0.5 * last)
    few = [here, find("sensor_position_error")]
    assert diagnose(BENCH.rig, train, effects=[here], catalogue=few).model.effects == (here,)
    model = Model(BENCH.rig).add(here)
    added = diagnose(model, train, effects=["sensor_position_error"], catalogue=few)
    assert added.model.effects[0] == here


def test_a_large_unbalance_does_not_become_a_mode_that_rings_on():
    """The free transient of a mode without damping is a tone, too; a speed a thousandth off leaves what asks for it."""
    rig = BENCH.rig.replace(speed=2.0 * np.pi * 41.0)
    hidden = {"unbalance": {"mass_eccentricity": 2e-5, "z": BENCH.middle, "phase": 0.7}}
    train = record(rig, hidden, 2)
    few = [find("unbalance"), find("foundation_resonance"), find("rotor_bending_mode")]
    found = diagnose(rig.replace(speed=1.001 * rig.speed), train, catalogue=few)
    assert found.effects == ("unbalance",), found
    assert found.history[-1].misfit < 1.02
    (unbalance,) = found.model.effects
    assert unbalance.frequency_hz == pytest.approx(41.0, abs=5e-3)  # a tenth of what the rig file is off
