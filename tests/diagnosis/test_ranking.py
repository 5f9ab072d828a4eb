"""The ranking puts first what is hidden: effects of a rotor and of several axes, in short records of the bench."""

import pytest

import ambid
from ambid.diagnosis import rank
from ambid.loop.effect import EffectParameter
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.one_axis import NAMED
from hidden.physics import CATALOGUE
from hidden.sizes import sized
from tiers import first_fast

BENCH = BENCHES["bench"]


@pytest.mark.parametrize("effect", first_fast([name for name in CATALOGUE if name not in NAMED], 3))
def test_the_hidden_effect_is_ranked_first(effect):
    hidden, rig = sized(effect, "large"), BENCH.known_to((effect,))
    i_e = ambid.prbs(8, amplitude=hidden.amplitude, hold=4, axes=4, periods=4)
    modes = None if effect == "rotor_bending_mode" else rig.rotor.flexible_modes
    record = measured(rig, i_e, {effect: hidden.parameters}, seed=1, flexible_modes=modes, **BENCH.truth)
    ranking = rank(ambid.compare(ambid.identify(rig, record).model, record))
    assert ranking.candidates[0].effect.name == effect


class Unfelt(ambid.Effect):
    """A port that nothing listens to, in two variants."""

    name = "unfelt"
    physics = signature = source = "nothing happens"

    def parameters(self, rig):
        return (EffectParameter("size", "1", 1.0),)

    def attach(self, plant):
        plant.port(self.slot("size"), plant["s.A_zeta"])

    def variants(self, seen):
        return (self, self)


def test_an_effect_that_no_record_can_feel_scores_nothing():
    i_e = ambid.prbs(7, amplitude=BENCH.amplitude, hold=4, axes=4, periods=4)
    record = measured(BENCH.rig, i_e, {}, seed=1, **BENCH.truth)
    (candidate,) = rank(ambid.compare(ambid.identify(BENCH.rig, record).model, record), [Unfelt()]).candidates
    assert (candidate.score, candidate.p_value) == (0.0, 1.0)
