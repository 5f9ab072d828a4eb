"""The ranking puts first what is hidden: effects of a rotor and of several axes, in short records of the bench."""

import pytest
from scipy.optimize import brentq

import ambid
from ambid.diagnosis import rank
from ambid.diagnosis.ranking import silent
from ambid.diagnosis.refits import ranked
from ambid.diagnosis.task import Task
from ambid.effects import find
from ambid.loop.effect import EffectParameter
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.one_axis import NAMED, ONE_AXIS
from hidden.physics import CATALOGUE
from hidden.sizes import sized
from tiers import first_fast

BENCH = BENCHES["bench"]


@pytest.mark.parametrize("effect", first_fast([name for name in CATALOGUE if name not in NAMED][1::2], 3))
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


def test_where_misfit_has_driven_a_model_off_effects_are_judged_where_it_began_too():
    hidden = {"loop_delay": {"seconds": 1e-4}}
    i_e = ONE_AXIS.excitation(ONE_AXIS.amplitude)
    record = measured(ONE_AXIS.rig, i_e, hidden, seed=1, period=ONE_AXIS.period, **ONE_AXIS.truth)
    start = ambid.Model(ONE_AXIS.rig)
    task = Task(start, (), ambid.CATALOGUE, silent)
    near, off = (ambid.compare(start.with_values({"tau_e": f * start["tau_e"].value}), record) for f in (1.1, 4.0))
    scores = [[c.score for c in rank(own).candidates] for own in (off.of(start), off)]
    both = ranked(task, off)
    assert ranked(task, near).at_fit == ()
    assert [c.score for c in both.candidates] == pytest.approx(scores[0])
    assert [c.score for c in both.at_fit] == pytest.approx(scores[1])


def test_a_lag_is_scored_where_a_probe_of_it_would_drive_the_loop():
    """A part of it does not, and says as much; a refit begins where a loop stands."""
    own = find("loop_delay")
    model = ambid.Model(ONE_AXIS.rig)
    edge = brentq(lambda tau: model.with_values({"tau_e": tau}).decay_rate, 1e-4, 5e-3)
    near = model.with_values({"tau_e": 0.999 * edge})
    probe = {p.name: p.probe for p in own.parameters(ONE_AXIS.rig)}
    assert near.is_stable
    assert not near.add(own, probe).is_stable
    train = measured(ONE_AXIS.rig, ONE_AXIS.excitation(ONE_AXIS.amplitude), {}, seed=1, **ONE_AXIS.truth)
    comparison = ambid.compare(near, train)
    (found,) = rank(comparison, [own]).candidates
    assert near.add(own, found.start).is_stable
    assert 0.0 < found.smallest_visible["delay"] < probe["delay"]
