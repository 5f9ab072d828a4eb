"""Viscous damping to ground, on a mass and on a whole rotor: named with its size, and nothing else in its place."""

from dataclasses import replace

import pytest

from ambid import diagnose, prbs
from ambid.effects import find
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS


def holds(parameter, truth):
    """Within four standard errors, which chance leaves once in sixteen thousand."""
    return abs(parameter.value - truth) < 4.0 * parameter.std_error


@pytest.fixture(scope="module")
def levitator():
    """A record of a mass that is damped to ground by 800 N s/m."""
    i_e = prbs(7, amplitude=0.5, hold=4, periods=4)
    hidden = {"external_damping": {"rate": 800.0 / ONE_AXIS.rig.rotor.mass}}
    return measured(ONE_AXIS.rig, i_e, hidden, seed=1, **ONE_AXIS.truth)


def test_that_of_a_mass_is_named_with_its_size(levitator):
    few = [find(name) for name in ("external_damping", "sensor_lag")]
    found = diagnose(ONE_AXIS.rig, levitator, catalogue=few)
    assert (found.verdict, found.effects) == ("explained", ("external_damping",)), found
    assert found.history[0].misfit > 100.0
    assert found.parameters["external_damping.damping"].value == pytest.approx(800.0, rel=0.02)
    assert holds(found.parameters["K_i.A_zeta"], ONE_AXIS.K_i[0])
    assert holds(found.parameters["K_s.A_zeta"], ONE_AXIS.K_s[0])


def test_an_effect_whose_size_a_record_does_not_tell_explains_nothing(levitator):
    """A saturation that is far away takes any level, and what is left stays as it is."""
    found = diagnose(ONE_AXIS.rig, levitator, catalogue=[find("flux_saturation")])
    assert (found.verdict, found.effects) == ("none_of_the_candidates", ()), found


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "seed"), [("small", 0), ("bench", 1)])
def test_that_of_a_rotor_is_no_seal_no_saturation_and_no_mode(machine, seed):
    """Of 2.5 1/s times the mass matrix; what once had its name, three together, is among the candidates."""
    own = replace(BENCHES[machine], order=7)
    i_e = own.excitation(own.amplitude, seed)
    record = measured(own.rig, i_e, {"external_damping": {"rate": 2.5}}, seed=seed, **own.truth, **own.noise)
    few = [find(name) for name in ("external_damping", "flux_saturation", "seal_forces", "bending_mode_shift")]
    found = diagnose(own.rig, record, catalogue=few)
    assert (found.verdict, found.effects) == ("explained", ("external_damping",)), found
    assert holds(found.parameters["external_damping.rate"], 2.5)
    for axis, k_i, k_s in zip(own.rig.axes, own.K_i, own.K_s, strict=True):
        assert holds(found.parameters[f"K_i.{axis}"], k_i), axis
        assert holds(found.parameters[f"K_s.{axis}"], k_s), axis
