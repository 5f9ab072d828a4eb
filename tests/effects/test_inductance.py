"""A voltage-driven coil with another inductance, against the independent simulator."""

import pytest

import ambid
from ambid.effects import find
from ambid.effects.coil import CURRENT_DRIVEN, WITHOUT_INDUCTANCE, InductanceError
from effects.test_damping import BENCH, at_truth, largest_error
from hidden.bench import measured, simulate
from hidden.one_axis import ONE_AXIS

RESISTANCE = 2.0
TYPICAL = {"error": 0.1, "gap_part": 0.1}


def voltage_driven(bench):
    """The rig of a bench whose controller commands as many volts as it commanded amperes, times R."""
    rig = bench.rig.replace(amplifier=bench.rig.amplifier.model_copy(update={"resistance": RESISTANCE}))
    pid = rig.controller
    louder = {own: RESISTANCE * getattr(pid, own) for own in ("proportional", "integral", "derivative")}
    return rig.replace(controller=pid.model_copy(update=louder))


def excitation(bench):
    return RESISTANCE * bench.excitation(bench.amplitude)[:400]


@pytest.mark.parametrize("times", [1.0, 10.0])
@pytest.mark.parametrize("bench", [ONE_AXIS, BENCH], ids=["one axis", "four axes"])
def test_it_is_the_physics_that_it_says(bench, times):
    """Also at ten times its typical size: twice the inductance, all reluctance in the gap."""
    rig, i_e = voltage_driven(bench), excitation(bench)
    values = {name: times * value for name, value in TYPICAL.items()}
    expected = simulate(rig, i_e, {"inductance_error": values}, seed=None, longest_step=1e-6, **bench.truth)
    base = at_truth(rig, bench)
    assert largest_error(base.add("inductance_error", values).simulate(i_e), expected) < 1e-6
    assert largest_error(base.simulate(i_e), expected) > 0.01 * times
    straight = base.add("inductance_error", values | {"gap_part": 0.0})
    assert largest_error(straight.simulate(i_e), expected) > 1e-3 * times


def test_an_inductance_alone_is_that_of_amplifier_bandwidth():
    rig, i_e = voltage_driven(ONE_AXIS), excitation(ONE_AXIS)
    base, (own,) = at_truth(rig, ONE_AXIS), find("amplifier_bandwidth").parameters(rig)
    other = base.add("inductance_error", {"error": 0.4, "gap_part": 0.0}).simulate(i_e)
    longer = base.add("amplifier_bandwidth", {own.name: 1.4 * RESISTANCE * rig.amplifier.time_constant})
    assert largest_error(other, longer.simulate(i_e)) < 1e-9
    assert "amplifier_bandwidth" in InductanceError.contains


def test_without_an_inductance_it_is_not_tried():
    assert find("inductance_error").why_not(ONE_AXIS.rig) == CURRENT_DRIVEN
    ideal = ONE_AXIS.rig.amplifier.model_copy(update={"resistance": 2.0, "time_constant": 0.0})
    assert find("inductance_error").why_not(ONE_AXIS.rig.replace(amplifier=ideal)) == WITHOUT_INDUCTANCE
    assert not find("inductance_error").parameters(ONE_AXIS.rig)


@pytest.mark.slow
def test_it_is_named():
    rig, values = voltage_driven(ONE_AXIS), {"error": 0.3, "gap_part": 0.8}
    u = RESISTANCE * ONE_AXIS.excitation(2.0 * ONE_AXIS.amplitude)
    train, validate = (measured(rig, u, {"inductance_error": values}, seed=seed, **ONE_AXIS.truth) for seed in (1, 2))
    found = ambid.diagnose(rig, train, validate=validate)
    assert (found.verdict, found.effects) == ("explained", ("inductance_error",)), found
    for name, value in values.items():
        assert found.parameters[f"inductance_error.{name}"].value == pytest.approx(value, rel=0.1)
