"""Near twins: one levitator at three sample rates gives one family with one number; all three together show more."""

import pytest

from ambid.diagnosis import diagnose
from ambid.diagnosis.families import shared_value
from ambid.effects import CATALOGUE, Effect, EffectParameter
from ambid.effects.traits import GAIN_OF_ANSWER, LAG_OF_READING, LAG_ROUND_LOOP
from ambid.excitation import prbs
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS, record

RATES = (2500.0, 5000.0, 10000.0)


class Courier(Effect):
    """The delay of the catalogue by another name."""

    name = "courier"
    physics = "a courier carries every command to the amplifier"
    signature = "as that of a delay"
    source = "this test"

    def parameters(self, rig):
        return [EffectParameter("journey", "s", 5e-6, lower=1e-8, upper=1e-3)]

    def traits(self, rig, values):
        return {LAG_ROUND_LOOP: values["journey"]}

    def attach(self, plant):
        plant.delay_commands(self.slot("journey"))


def at_rates(hidden, *, with_i_c):
    """A record at each sample rate, of one mass and controller gains, with its rig."""
    controller = ONE_AXIS.rig.controller.model_copy(update={"implementation": "digital"})
    found = []
    for rate in RATES:
        rig = ONE_AXIS.rig.replace(sample_rate=rate, controller=controller)
        i_e = prbs(8, amplitude=1.0, hold=round(rate / RATES[0]), periods=6)
        one = measured(rig, i_e, hidden, seed=int(rate), with_i_c=with_i_c, **ONE_AXIS.truth)
        found.append((rig, one.at(rig)))
    return found


@pytest.fixture(scope="module")
def delayed():
    """A delay of 0.1 ms, as y alone shows it."""
    return at_rates({"loop_delay": {"seconds": 1e-4}}, with_i_c=False)


@pytest.fixture(scope="module")
def alone(delayed):
    """Each of these records diagnosed by itself."""
    return [diagnose(rig, one) for rig, one in delayed]


def test_the_same_family_with_the_same_number_at_every_rate(alone):
    for found in alone:
        (family,) = found.families.values()
        assert set(family.members) >= {"loop_delay", "sensor_lag"}
        assert (family.values[0], family.unit) == (pytest.approx(1e-4, rel=0.03), "s")
        assert family.shared.endswith(LAG_ROUND_LOOP.where)


@pytest.mark.slow
def test_all_rates_together_name_the_truth(delayed):
    """A y that is read early delays the loop as much; where i_c is not recorded, nothing distinguishes them."""
    found = diagnose(delayed[0][0], [one for _, one in delayed])
    assert found.effects == ("loop_delay",), found
    assert found.ambiguous_sets in ([], [["loop_delay", "sampling_skew"]])
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_all_rates_together_leave_a_smaller_family():
    slow, *others = at_rates({"sensor_lag": {"tau": 5e-5}}, with_i_c=True)
    alone = diagnose(*slow).families["sensor_lag"]
    assert set(alone.members) == {"sensor_lag", "sampling_skew", "amplifier_bandwidth"}
    together = diagnose(slow[0], [slow[1], *(one for _, one in others)])
    assert together.effects == ("sensor_lag",)
    assert set(together.families["sensor_lag"].members) < set(alone.members)
    assert together.families["sensor_lag"].values[0] == pytest.approx(5e-5, rel=0.03)


@pytest.mark.slow
def test_an_effect_of_your_own_joins(delayed):
    rig, one = delayed[1]
    found = diagnose(rig, one, catalogue=[effect for effect in CATALOGUE if effect.name != "loop_delay"] + [Courier()])
    (family,) = found.families.values()
    assert "courier" in family.members


def test_it_is_told_in_text_and_json(alone, golden):
    found = alone[1]
    (family,) = found.families.values()
    (own,) = found.to_json()["families"].values()
    assert (own["members"], own["shared"]) == (list(family.members), family.shared)
    assert (own["values"], own["unit"]) == (list(family.values), "s")
    golden.holds(family.line())
    assert family.line() in str(found)
    assert family.line() in found.summary()


@pytest.mark.slow
def test_what_no_other_effect_does_has_no_family():
    assert diagnose(ONE_AXIS.rig, record({"sensor_lag": {"tau": 1e-4}}, 1)).families == {}


def test_a_negative_lag_is_a_lead(golden):
    """A record of the current that lags by a sample makes y come earlier."""
    golden.holds(shared_value(LAG_OF_READING, (-1e-4, -1.1e-4)))
    golden.holds(shared_value(GAIN_OF_ANSWER, (-0.05,)))
