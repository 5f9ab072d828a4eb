"""Sets of effects: without noise, and what the states of effects may do when a record begins."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from ambid import Model, compare, diagnose, identify, prbs
from ambid.diagnosis import refits, search
from ambid.diagnosis.candidates import Candidate, Ranking
from ambid.diagnosis.evidence import BOUNDLESS, Evidence, Kind, Yardstick, about_sizes, information_on
from ambid.diagnosis.hypotheses import Field, Hypothesis, begun
from ambid.diagnosis.nameless import DECADES, Shown, Ways
from ambid.diagnosis.probabilities import probabilities
from ambid.diagnosis.ranking import rank, silent
from ambid.diagnosis.task import Task
from ambid.effects import find
from ambid.effects.shapes import SHAPES
from ambid.effects.support import MagneticPull
from ambid.errors import UnstableLoopError
from ambid.identification.minimum import refit
from ambid.noise import Comparison, Noise
from hidden.bench import measured, simulate
from hidden.dirt import MARGIN, NOISE_FREE, soiled
from hidden.experiment import experiment_on
from hidden.families import BENCHES
from hidden.one_axis import NAMED, ONE_AXIS, record
from hidden.sizes import Sized, sized
from hidden.strangers import stranger

MANY = 12
WAYS = np.full(MANY, 1.0 / MANY)


@pytest.mark.slow
def test_without_any_noise_nothing_is_left():
    """Of this record the cost of the right model is zero in all digits."""
    bench = BENCHES["bench"]
    one = bench.excitation(bench.amplitude, 2)[: bench.period]
    i_e = np.take(one, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    hidden = {"seal_forces": sized("seal_forces", "clear").parameters}
    record = simulate(bench.rig, i_e, hidden, period=bench.period, seed=None, **bench.truth)
    few = [find(name) for name in ("seal_forces", "external_damping", "coupling_stiffness", "loop_delay", "back_emf")]
    found = diagnose(bench.rig, soiled(record, NOISE_FREE, np.random.default_rng(2), bench.rig), catalogue=few)
    assert found.effects == ("seal_forces",)
    assert found.history[-1].misfit < 1e-8


def of(left, on_tones=0.0, waves=0):
    """A base model that leaves so much beyond the noise of 1000 numbers."""
    return Evidence(
        cost=1000.0 + left, expected=1000.0, deviation=45.0, formula_errors={}, usual_errors={}, beginnings=0.0,
        information=np.zeros((0, 0)), kinds=(), prior=0.0, on_tones=on_tones, waves=waves,
    )  # fmt: skip


@pytest.mark.parametrize("left", [100.0, 1e3, 1e4])
def test_something_else_is_so_many_numbers_of_an_unknown_power(left, validated):
    """Against the integral over that power, which is within three decades about what is left."""

    def likelihood(log_power):
        power = np.exp(log_power)
        cost = (MANY + left) / (1.0 + power) - MANY
        return np.exp(-0.5 * (cost + MANY * np.log1p(power)) + shift)

    best, reach = np.log(left / MANY), DECADES * np.log(10.0)
    shift = 0.5 * MANY * np.log1p(left / MANY)
    expected = np.log(quad(likelihood, best - reach / 2.0, best + reach / 2.0, points=[best])[0] / reach) - shift
    right = of(0.0)
    validated(
        "Log probability of something that has no name: deviation",
        "integral over its unknown power by SciPy {scipy}",
        of(left).beside(left, right, WAYS) - right.beside(0.0, right, WAYS) - expected,
        0.3,
    )


def test_a_set_that_leaves_nothing_of_what_has_a_shape_did_so_by_luck():
    """Of so many numbers with the power of the shape, against their normal density; no more than that is expected."""
    right, score = of(0.0), 300.0
    power = 1.0 + score / MANY
    density = -0.5 * MANY * np.log(power) + 0.5 * MANY * (1.0 - 1.0 / power)  # over that of noise alone
    assert right.beside(0.0, right, WAYS, score) - right.beside(0.0, right, WAYS) == pytest.approx(density)
    assert of(1e3).beside(1e3, right, WAYS, score) == of(1e3).beside(1e3, right, WAYS)


def direction_among(angles):
    """Candidates whose changes of the response lie at these angles of a plane."""
    rows = np.column_stack([np.cos(angles), np.sin(angles)])
    return tuple(Candidate(None, 0.0, 1, {}, 1.0, direction=row, size=1.0) for row in rows)


def test_candidates_are_as_many_as_the_records_tell_apart():
    """Two of three leave a hundredth where one stands for the other."""
    ranking = Ranking(direction_among([0.0, np.arcsin(0.1), np.pi / 2.0 + 0.05]), 5.0, ())
    assert ranking.told_apart == pytest.approx(2.0, abs=0.1)


def test_an_effect_is_less_sure_beside_what_has_no_name():
    """Neither is what else takes its linear part; alone it is sure, since it leaves so little."""
    bench = BENCHES["bench"]
    i_e = bench.excitation(bench.amplitude, 1)
    fit = compare(bench.rig, simulate(bench.rig, i_e, {}, period=bench.period, seed=1, **bench.truth, **bench.noise))
    ranking = Ranking(direction_among(np.linspace(0.0, 1.5, 6)), 5.0, ())
    yardstick = Yardstick(fit, None, {"loop_delay": 0.05} | {f"effect {k}": 0.05 for k in range(5)})
    base, one = of(3e4), replace(of(0.0), kinds=(Kind(1, 0),), information=np.eye(1) * 3e4, prior=3.0)
    tried = {
        frozenset(effect.name for effect in added): Hypothesis(added, fit, None, 1.0, evidence)
        for added, evidence in (((), base), ((find("loop_delay"),), one))
    }
    field = Field(yardstick, tried, whole=ranking)
    sure, nameless = probabilities(field), probabilities(field, 40.0, shape=300.0)
    assert nameless.something_else > 0.999
    assert nameless.effects["loop_delay"] < 0.85 < 0.9 < sure.effects["loop_delay"]


@pytest.mark.parametrize("is_usual", [False, True])
def test_what_a_formula_may_leave_is_no_reason_against_an_effect_that_takes_all_of_it(is_usual):
    """It could be of any kind; what it leaves as a rule speaks for nothing else."""
    fit = compare(Model(ONE_AXIS.rig), record({}, 3))
    sets = [(), (find("coulomb_friction"),), (find("coulomb_friction"), find("channel_gain"))]
    kinds = [(), (Kind(1, 0),), (Kind(1, 0), Kind(4, 0))]
    errors = {frozenset(): 0.03}
    tried = {
        frozenset(effect.name for effect in own): Hypothesis(
            own,
            fit,
            None,
            1.0,
            replace(
                of(left), kinds=kind, information=1e3 * np.eye(sum(each.numbers for each in kind)),
                prior=3.0 * len(own), formula_errors=errors if own else {},
                usual_errors=errors if own and is_usual else {},
            ),
        )
        for own, left, kind in zip(sets, (7e4, 2e3, 0.0), kinds, strict=True)
    }  # fmt: skip
    assert Field(Yardstick(fit, None, {}), tried).best.added == sets[1 if is_usual else 2]


def test_a_formula_may_leave_what_it_may_though_its_set_without_it_was_not_tried():
    """What it explains is then judged beside what was tried within that set."""
    names = [frozenset(own) for own in ((), ("sensor_runout", "rotor_contact"))]
    tried = {own: Hypothesis((), None, None, 1.0, of(0.0 if own else 4e4)) for own in names}
    errors = {frozenset({"rotor_contact"}): 1e-3}
    assert Field(None, tried).of_formulas(replace(of(0.0), formula_errors=errors)) == pytest.approx(40.0)


def test_what_a_refit_took_beside_a_set_in_another_noise_it_takes_of_whatever_is_left():
    """Also of a set that leaves less than one of J: a part of at least one was remembered."""
    own, tried = frozenset({"coulomb_friction"}), {frozenset(): 1e4, frozenset({"coulomb_friction"}): 0.0}
    field = Field(None, {names: Hypothesis((), None, None, 1.0, of(left)) for names, left in tried.items()})
    field = replace(field, parts={(own, "seal_forces"): 30.0})
    assert field.fall_beside(replace(field.tried[own], added=(find("coulomb_friction"),)), "seal_forces") == 30.0
    assert field.fall_beside(field.tried[frozenset()], "seal_forces") is None


def test_something_else_acts_in_the_ways_of_all_effects_whichever_are_proposed():
    """With few ways it would be too cheap: it costs what it has to choose from."""
    rig = ONE_AXIS.rig
    fit = identify(
        rig, measured(rig, prbs(7, amplitude=0.2, hold=4, periods=4), {}, seed=1, **ONE_AXIS.truth)
    ).comparison
    task = Task(fit.model, (), (find("coulomb_friction"),), silent)
    *_, few = search.explored(task, begun(task, fit))
    assert few.ways.powers == pytest.approx(rank(fit).ways.powers)
    assert set().union(*few.tried) <= {"coulomb_friction"}
    assert [c.effect.name for c in few.rankings[frozenset()].candidates] == ["coulomb_friction"]


def test_what_a_lag_takes_beside_another_lag_is_not_what_it_takes_alone():
    """Alone the one stands in for the other; a refit of it tells nothing of both, but of it beside a stiffness."""
    names = [frozenset(own) for own in ((), ("eddy_currents",), ("sensor_lag",), ("seal_forces",))]
    tried = {own: Hypothesis((), None, None, 1.0, of(1e4 if not own else 100.0)) for own in names}
    field = Field(None, tried).felt(frozenset(), "sensor_lag")
    (part,) = field.parts.values()
    assert part == pytest.approx(1.0, abs=0.05)
    for effect, likes, falls in (("seal_forces", (), True), ("eddy_currents", ("eddy_currents",), False)):
        own = Hypothesis((find(effect),), None, None, 1.0, of(100.0))
        assert (field.felt_before(own, "sensor_lag", frozenset(likes)) is not None) == falls


def test_the_best_set_is_carried_on_though_it_had_fallen_behind(monkeypatch):
    """Two that stood in for another of it were ahead before, and more was tried beside those."""
    best, pair = frozenset({"sensor_runout"}), frozenset({"flux_saturation", "unbalance"})
    left = {frozenset(): 1e4, best: 10.0, pair: 80.0}
    tried = {own: Hypothesis(tuple(map(find, own)), None, None, 1.0, of(more)) for own, more in left.items()}
    carried = []

    def noted(task, field, names, **_):
        carried.append(names)
        yield field

    monkeypatch.setattr(search, "_carried_on", noted)
    *_, end = search.reconsidered(None, Field(None, tried, {pair: Ranking((), 1.0, ())}))
    assert (end.foremost.names, carried) == (best, [best])


@pytest.mark.parametrize(("left", "leads_on"), [(1e5, True), (7e5, False)])
def test_what_leads_nowhere_is_tried_with_no_more(monkeypatch, left, leads_on):
    """Of n effects that are missing, the largest explains no less than 1/n of what was left."""
    fit = compare(Model(ONE_AXIS.rig), record({}, 3))
    names = [frozenset(own) for own in ((), ("back_emf",), ("back_emf", "eddy_currents"))]
    tried = {
        own: Hypothesis(tuple(map(find, own)), fit, None, 1.0, of(more))
        for own, more in zip(names, (1e6, 8e5, left), strict=True)
    }
    carried = []

    def noted(task, field, names, *, by_scores=False):
        if not by_scores:
            carried.append(names)
        yield field

    monkeypatch.setattr(search, "_carried_on", noted)
    monkeypatch.setattr(search, "without", lambda task, field, *_: field)
    monkeypatch.setattr(search, "_with_twins", lambda *_: ())
    list(search.reconsidered(None, Field(None, tried, {})))
    assert carried == [names[-1]] * leads_on


def test_what_is_left_of_a_set_is_fitted_from_the_values_that_it_had_without(monkeypatch):
    """Where the effect that is taken out held the loop, its own values make none; places are those beside it."""
    rig = BENCHES["bench"].rig
    known, moved = find("external_damping", {"z": 0.2}), find("external_damping", {"z": 0.3})
    alone = Model(rig).add(known, {"damping": 5.0})
    both = Model(rig).add(moved, {"damping": 9.0}).add("back_emf")
    fit = compare(both, simulate(rig, BENCHES["bench"].excitation(0.05, 1), {}, seed=1, **BENCHES["bench"].truth))
    begun = []

    def fitted(start, **_):
        begun.append(start.model)
        raise UnstableLoopError("a pole grows")

    monkeypatch.setattr(refits, "refit", fitted)
    tried = {frozenset({known.name}): Hypothesis((known,), fit.of(alone), None, 1.0, of(0.0))}
    whole = Hypothesis(both.effects, fit, None, 1.0, of(0.0))
    refits.without(Task(Model(rig), (), (), silent), Field(None, tried), whole, both.effects[1])
    assert [(model.effects, model["external_damping.damping"].value) for model in begun] == [
        ((moved,), 9.0),
        ((moved,), 5.0),
    ]


@pytest.mark.parametrize(("beginnings", "prior", "may_win"), [(0.0, 30.0, True), (70.0, 0.0, False)])
def test_what_a_set_leaves_may_have_driven_how_its_states_begin(beginnings, prior, may_win):
    """A wave that is missing looks like states that begin far from rest, and costs as these do; with it they do not."""
    rig = BENCHES["bench"].rig
    excited = simulate(rig, BENCHES["bench"].excitation(0.05, 1), {}, seed=1, **BENCHES["bench"].truth)
    eddy, runout = find("eddy_currents"), find("sensor_runout")
    with_runout = replace(of(0.0), beginnings=beginnings, prior=prior)
    own = {(): of(1e4), (eddy,): replace(of(300.0), beginnings=70.0), (eddy, runout): with_runout}
    fit = compare(Model(rig), excited)
    tried = {frozenset(e.name for e in some): Hypothesis(some, fit, None, 1.0, of_it) for some, of_it in own.items()}
    candidate = Candidate(find("unbalance"), 300.0, 2, {}, 1.0)
    task = Task(Model(rig), (), (eddy, runout, candidate.effect), silent)
    assert search.may_win(task, Field(None, tried), tried[frozenset({eddy.name})], candidate) is may_win


def test_sets_that_are_like_the_best_end_where_its_values_lead():
    """One that a rough descent left a little off is no worse for that."""
    fit = identify(
        ONE_AXIS.rig, record({"loop_delay": {"seconds": 2e-6}, "back_emf": {"coefficient": 20.0}}, 1)
    ).comparison
    best, like = ((find(lag), find("back_emf")) for lag in ("loop_delay", "amplifier_bandwidth"))
    right, other = (refit(fit.of(fit.model.add(own[0]).add(own[1]))) for own in (best, like))
    (k_i,) = (p for p in other.model.parameters if p.name.startswith("K_i"))
    off = other.of(other.model.with_values({k_i.name: 1.0001 * k_i.value}))
    field = begun(Task(fit.model, (), (*best, like[0]), silent), fit).with_(best, right).with_(like, off)
    ends = refits.ended(field, frozenset(effect.name for effect in best))
    reached = ends.tried[frozenset(effect.name for effect in like)].fit.cost
    assert off.cost > other.cost + 5.0
    assert reached < other.cost + 0.5


@pytest.mark.slow
def test_without_periods_a_set_is_at_the_minimum_of_j_in_the_noise_that_it_leaves():
    """Which comes from the residual: in that of the model without it J would fall by 10 more."""
    bench, effect = BENCHES["bench"], find("foundation_resonance")
    i_e = prbs(9, amplitude=bench.amplitude, hold=5, axes=4, periods=3, seed=68)
    hidden = {effect.name: sized(effect.name, "clear").parameters}
    own = measured(bench.rig, i_e, hidden, seed=68, **bench.truth, **bench.noise)
    fit = identify(Model(bench.rig), replace(own, period=None)).comparison
    task, names = Task(fit.model, (), (effect,), silent), frozenset({effect.name})
    field = begun(task, fit).with_((effect,), refit(fit.of(fit.model.add(effect))))
    best = refits.refined(task, field, names).tried[names].fit.renewed()
    assert best.cost - refit(best).cost < 0.1


class WaysThatShow(Ways):
    """Those in which so much of J stands, where a set leaves it."""

    def shown(self, residual, known):
        return Shown(odds=290.0, explains=640.0, beyond=600.0) if "loop_delay" in known else Shown()


def test_the_information_on_a_stiff_law_is_of_what_it_changes():
    """Near where its steps are too long the derivatives of dry friction grow by themselves, and its value does not."""
    rig, values = ONE_AXIS.rig, {"force": 2.9, "inverse_width": 3.152e6, "inverse_exponent": 0.1354}
    i_e = np.repeat(ONE_AXIS.amplitude * np.random.default_rng(3).choice([-1.0, 1.0], (1000, 1)), 4, axis=0)
    run = measured(rig, i_e, {"coulomb_friction": {"force": 3.0, "z": ONE_AXIS.middle}}, seed=0, **ONE_AXIS.truth)
    fit = compare(Model(rig), run)
    model = Model(rig).add(find("coulomb_friction"), values)
    kinds = [[model.names.index(f"coulomb_friction.{name}")] for name in values]
    each = [fit.of(model.with_substeps(steps)) for steps in (128, 32)]
    fine, coarse = (information_on(about_sizes(own, kinds), own.model, kinds) for own in each)
    assert np.diag(fine).min() > 0.0
    np.testing.assert_allclose(np.log1p(np.diag(coarse)), np.log1p(np.diag(fine)), atol=0.5)
    own, every = [k for (k,) in kinds], list(range(len(model.names)))
    exact = fit.noise.quadratic(model.with_substeps(128), every).hessian * np.outer(*2 * [model.theta])
    freed = np.linalg.inv(np.linalg.inv(exact)[np.ix_(own, own)])  # from what all others absorb
    np.testing.assert_allclose(np.log1p(np.diag(fine)), np.log1p(np.diag(freed)), atol=0.1)


def test_where_a_set_explains_another_is_followed_as_far_as_it_may_be_of_account():
    """Higher by what the formula of an effect leaves as a rule; as far as it goes where no set explains."""
    delay, seal, friction = (find(name) for name in ("loop_delay", "seal_forces", "coulomb_friction"))
    plain = compare(Model(ONE_AXIS.rig), record({"loop_delay": {"seconds": 2e-4}}, 1))
    base = Hypothesis((), plain, None, 1.0, of(4e4))
    right = Hypothesis((delay,), refit(plain.of(plain.model.add(delay, {}))), None, 1.0, of(0.0))
    assert Field(None, {base.names: base}).bar(base, seal) == np.inf
    explained = Field(None, {own.names: own for own in (base, right)})
    assert right.fit.cost < explained.bar(base, seal) < right.fit.cost + 100.0
    assert explained.bar(base, friction) == pytest.approx(explained.bar(base, seal) + 2e-3 * plain.cost)


def test_what_is_not_priced_is_no_more_likely_than_it_seems():
    """A set that is far behind anyway keeps its J, and is not taken for less likely than it is."""
    run = record({"loop_delay": {"seconds": 2e-4}}, 1)
    base, lag = compare(Model(ONE_AXIS.rig), run), find("sensor_lag")
    yardstick, fit = Yardstick(base, None, {}), refit(base.of(base.model.add(lag, {})))
    priced, unpriced = (yardstick.evidence(fit, None, (lag,), 1.0, is_priced=own) for own in (True, False))
    assert unpriced.cost == priced.cost
    assert unpriced.alone > priced.alone


def test_what_something_else_takes_up_counts_once():
    """What a wrong set leaves, within chance of all lines but in the ways of effects, is no more than the right one
    takes: something else beside the wrong set is not likelier than the right set alone."""
    bench = BENCHES["bench"]
    i_e = bench.excitation(bench.amplitude, 1)
    fit = compare(bench.rig, simulate(bench.rig, i_e, {}, period=bench.period, seed=1, **bench.truth, **bench.noise))
    ranking = replace(Ranking(direction_among(np.linspace(0.0, 1.5, 6)), 5.0, ()), ways=WaysThatShow())
    field = Field(Yardstick(fit, None, {"loop_delay": 0.05, "sensor_lag": 0.05}), whole=ranking)
    noise = {"kinds": (Kind(1, 0),), "information": np.eye(1) * 3e4, "prior": 3.0, "deviation": 247.0}
    right, wrong = replace(of(0.0), **noise), replace(of(640.0), **noise)
    sets = {(): replace(of(2e4), deviation=247.0), ("sensor_lag",): right, ("loop_delay",): wrong}
    tried = {
        frozenset(names): Hypothesis(tuple(find(name) for name in names), fit, None, 1.0, own)
        for names, own in sets.items()
    }
    field = replace(field, tried=tried)
    best, other = (tried[frozenset({name})] for name in ("sensor_lag", "loop_delay"))
    assert field.is_of_formulas(best)
    assert field.is_of_formulas(other)
    assert max(field.besides(other)) < field.alone(best.evidence) - 10.0
    assert field.best is best


def test_a_wave_is_not_smooth():
    """What stands on lines of its own is dearer to something else than as much that is smooth, and free once named."""
    right = of(0.0, on_tones=16.0, waves=16)
    smooth, standing = of(3000.0, 16.0, 16), of(3000.0, 3016.0, 16)
    assert standing.beside(3000.0, right, WAYS) != smooth.beside(3000.0, right, WAYS)
    both = of(6000.0, 3016.0, 16)
    assert (
        both.beside(6000.0, right, WAYS)
        < min(smooth.beside(3000.0, right, WAYS), standing.beside(3000.0, right, WAYS)) - 20.0
    )
    assert of(6000.0).beside(6000.0, right, WAYS) > both.beside(6000.0, right, WAYS) + 10.0


def test_the_truth_begins_a_short_record_settled_though_its_parameters_are_hardly_told():
    """Eddy currents beside a lag and a pull: 255 chips show little of the pull that what began the record does not.

    At the least of J alone the squares of how the states of the eddy currents begin are 6.8 times those of their
    errors, which costs 1.5 a state; where both are least, the cost is less than 1, of noise alone it is 0.5.
    """
    machine = replace(stranger(13253), order=8)
    hidden = {
        "amplifier_bandwidth": {"frequency_hz": 6578.85, "damping": 2.354},
        "eddy_currents": {"tau": 4.018e-5},
        "magnetic_pull": {"stiffness": 54650.0, "z": 0.283},
    }
    rig, train, _, _ = experiment_on(machine, {name: Sized(own, 0.341, 0.0) for name, own in hidden.items()}, 3)
    base = compare(Model(rig), train)
    model = Model(rig).add(find("amplifier_bandwidth"), {}).add(find("eddy_currents"), {})
    fit = refit(base.of(model.add(MagneticPull(0.283), {})).renewed())
    yardstick = Yardstick(base, None, dict.fromkeys(hidden, 0.01))
    numbers = fit.noise.quadratic(fit.model, []).fitted - base.noise.quadratic(base.model, []).fitted
    assert yardstick.evidence(fit, None, fit.model.effects, 1.0).beginnings < numbers


def test_where_a_record_begins_settled_is_sought_as_far_off_as_the_truth_is():
    """K_s are known to 40 %: the fit begins the record at 500 times what its errors are, a linear step at 140 times."""
    machine = replace(stranger(35566), order=8)
    rig, train, _, _ = experiment_on(machine, {"eddy_currents": Sized({"tau": 1e-4}, 0.11, 0.0)}, 35566)
    base = compare(Model(rig), train)
    fit = refit(base.of(base.model.add(find("eddy_currents"))))
    numbers = fit.noise.quadratic(fit.model, []).fitted - base.noise.quadratic(base.model, []).fitted
    evidence = Yardstick(base, None, {"eddy_currents": 0.01}).evidence(fit, None, fit.model.effects, 1.0)
    assert evidence.beginnings < numbers


@pytest.mark.slow
def test_records_kept_back_cost_what_a_fit_to_them_too_leaves():
    """One step of Newton's, with rough derivatives of what is not linear, leads where both records are fitted best."""
    hidden = {"coulomb_friction": NAMED["coulomb_friction"]}
    train, other = record(hidden, 3), record(hidden, 4, 0.8)
    base, kept_back = compare(Model(ONE_AXIS.rig), train), compare(Model(ONE_AXIS.rig), other)
    fit = refit(base.of(base.model.add(find("coulomb_friction"))).renewed())
    kept_back = kept_back.of(fit.model).renewed()
    yardstick = Yardstick(base, kept_back, {"coulomb_friction": 0.05})
    joint = refit(Comparison(fit.model, [train, other], Noise.of_parts([*fit.noise.parts, *kept_back.noise.parts])))
    assert yardstick.evidence(fit, kept_back, fit.model.effects, 1.0).cost == pytest.approx(joint.cost, abs=1.0)


def test_no_loop_that_leaves_all_bounds_made_a_record_that_was_kept_back():
    """It is worth nothing, and ends no search."""
    train, loud = record({}, 3), record({}, 4, 10.0)
    base, kept_back = (compare(Model(ONE_AXIS.rig), own) for own in (train, loud))
    model = base.model.add(find("force_nonlinearity"), {})
    yardstick = Yardstick(base, kept_back, {"force_nonlinearity": 0.05})
    found = yardstick.evidence(base.of(model), kept_back.of(model), model.effects, 1.0)
    assert found.cost == BOUNDLESS
    assert found.expected > base.dof + 0.9 * kept_back.dof


def test_a_shape_without_a_name_that_leaves_much_makes_no_effect_beside_it_sure():
    """It comes nearer to noise than all sets with names do, and far from it: something else may act as these, too."""
    fit = compare(Model(ONE_AXIS.rig), record({}, 3))
    lost = find("excitation_gain_error")
    sets = {own: (lost,) if own else () for own in (frozenset(), frozenset({lost.name}))}
    left = dict(zip(sets, (4e4, 2e4), strict=True))
    tried = {own: Hypothesis(sets[own], fit, None, 1.0, of(left[own])) for own in sets}
    spring = Hypothesis((lost, *SHAPES), fit, None, 1.0, of(1e4))
    field = Field(Yardstick(fit, None, {lost.name: 0.01}), tried, nameless={frozenset({lost.name}): spring})
    ranking = rank(fit, [lost, find("sensor_lag")])
    found = probabilities(replace(field, whole=ranking))
    assert found.something_else > 0.999
    assert found.effects[lost.name] < 0.9
