"""Identification against known truth: the demo's bench, and virtual experiments that owe nothing to the package."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ambid.errors import ModelError, RecordError, Stopped, UnstableLoopError
from ambid.excitation import prbs
from ambid.identification import identify
from ambid.identification.estimate import STATUS
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY, Descent, noise_levels
from ambid.model import Model
from ambid.noise import compare
from ambid.record import Record
from ambid.rig import Actuator
from hidden.one_axis import NAMED, ONE_AXIS
from hidden.one_axis import record as hidden_record
from validated import relative
from virtual import AXES, NAMES, VirtualBench


def values(estimate) -> np.ndarray:
    return np.array([p.value for p in estimate.parameters.values()])


def errors(estimate) -> np.ndarray:
    return np.array([p.std_error for p in estimate.parameters.values()])


def held(estimate, truth) -> int:
    """Number of intervals that hold the truth."""
    return sum(p.ci95[0] <= truth[name] <= p.ci95[1] for name, p in estimate.parameters.items())


@pytest.fixture(scope="module")
def start(bench):
    """The bench's rig with nominal values off by up to 8 %."""
    return Model(bench.rig(off=0.08))


@pytest.fixture(scope="module")
def estimate(start, run):
    return identify(start, run)


def test_the_demo_is_identified_within_its_intervals(demo_estimate, demo_truth):
    for name, p in demo_estimate.parameters.items():
        assert_allclose(p.value, demo_truth[name], rtol=0.03 if name == "tau_e" else 0.015)
    assert held(demo_estimate, demo_truth) >= 8
    assert demo_estimate.status == "converged"
    assert abs(demo_estimate.fit_percent["average"] - demo_estimate.noise_ceiling_percent["average"]) < 0.1


def test_a_descent_that_promises_to_end_above_what_was_reached_is_left(estimate):
    fit = estimate.comparison
    beside = fit.of(fit.model.with_values({"tau_e": 1.01 * fit.model["tau_e"].value}))
    assert beside.cost > 1.01 * fit.cost
    assert refit(beside, bound=0.5 * fit.cost).cost == pytest.approx(beside.cost)
    assert refit(beside, bound=fit.cost).cost == pytest.approx(fit.cost)


def test_nor_is_one_followed_that_starts_where_physics_is_missing():
    """What is left is far above noise, of which values that are known to a tolerance take their part of J."""
    record = hidden_record({"loop_delay": NAMED["loop_delay"]}, 0)
    fit = identify(ONE_AXIS.rig.replace(tolerance={}), record).comparison
    beside = fit.of(fit.model.with_values({"tau_e": 1.01 * fit.model["tau_e"].value}))
    assert beside.cost > fit.cost > 100.0 * fit.dof
    lowest = refit(beside, bound=fit.cost).cost
    assert lowest <= fit.cost * (1.0 + 1e-5)
    assert refit(beside, bound=0.1 * fit.cost).cost > lowest + 100.0


def test_noise_free_data_give_the_truth(bench, start, i_e, validated):
    clean = bench.records(i_e, [0], period=510, sensor_noise=0.0, current_noise=0.0)
    found = identify(start, clean)
    validated(
        "K_i, K_s, tau_e of four axes from records without noise: relative error",
        "truth of an independent bench, equations of motion by matrix exponential (SciPy {scipy})",
        relative(values(found), list(bench.truth.values())),
        1e-7,
    )
    assert found.fit_percent["average"] > 99.9999


@pytest.fixture(scope="module", params=[pytest.param(40, marks=pytest.mark.slow)], ids="{} seeds".format)
def many(bench, request):
    """Estimates from independent noise, and the standard errors that sigma^2 (J'J)^-1 would give them."""
    i_e = prbs(7, amplitude=0.15, hold=2, axes=4, periods=6)
    begin = Model(bench.rig(off=0.02))
    found, naive = [], []
    for record in bench.records(i_e, range(1000, 1000 + request.param), period=254):
        found.append(identify(begin, record))
        naive.append(textbook_errors(found[-1], record))
    return found, np.array(naive)


def textbook_errors(estimate, record) -> np.ndarray:
    weight = 1.0 / noise_levels([record])[0]
    model = estimate.model
    y, jacobian = model.loop.sensitivity(model.theta, record.i_e, range(9))
    residual = weight * (np.hstack([record.y, record.i_c]) - y)
    lines = weight[:, None] * (jacobian - jacobian.mean(axis=0))
    lines = lines.reshape(-1, 9)
    return np.sqrt((residual - residual.mean(axis=0)).var() * np.diag(np.linalg.inv(lines.T @ lines)))


def test_intervals_hold_the_truth_95_times_in_100(bench, many, validated):
    """The rate over independent seeds and 9 correlated parameters lies within 3.6 of its standard deviations.

    The indicators of one seed have a mean correlation of about 0.18. Of one parameter alone the bound is 4.
    """
    truth = np.array(list(bench.truth.values()))
    inside = np.array([np.abs(values(e) - truth) < 1.959964 * errors(e) for e in many[0]])
    deviation = np.sqrt(0.95 * 0.05 / len(inside))
    validated(
        "95 % intervals of 9 parameters, 40 seeds: deviation of their coverage from 0.95",
        "truth of an independent bench; 3.6 binomial standard deviations",
        inside.mean() - 0.95,
        3.6 * np.sqrt(0.18) * deviation,
    )
    assert np.all(np.abs(inside.mean(axis=0) - 0.95) < 4.0 * deviation)


def test_estimates_have_no_bias_and_their_stated_scatter(bench, many, validated):
    """A mean of n unit normal numbers has 1 / sqrt(n), their standard deviation 1 / sqrt(2 n)."""
    truth = np.array(list(bench.truth.values()))
    z = np.array([(values(e) - truth) / errors(e) for e in many[0]])
    validated(
        "Bias of 9 parameters over 40 seeds, in standard errors of one estimate",
        "truth of an independent bench; 4 standard deviations of a mean",
        z.mean(axis=0),
        4.0 / np.sqrt(len(z)),
    )
    validated(
        "Scatter of 9 parameters over 40 seeds: relative deviation from the stated standard error",
        "truth of an independent bench; 4 standard deviations of a scatter",
        z.std(axis=0) - 1.0,
        4.0 / np.sqrt(2.0 * len(z)),
    )


def test_textbook_intervals_would_be_too_short(bench, many):
    """Why the covariance is a sandwich: the loop colours the residual."""
    truth = np.array(list(bench.truth.values()))
    found, naive = many
    off = np.array([values(e) - truth for e in found])
    assert np.mean(np.abs(off) < 1.959964 * naive) < 0.9


def test_y_alone_is_enough(bench, start, run, estimate):
    """The model known but for nine numbers, noisy currents hardly add to them."""
    of_y = identify(start, replace(run, i_c=None))
    assert held(of_y, bench.truth) >= 7
    assert_allclose(errors(of_y), errors(estimate), rtol=0.1)
    assert set(of_y.fit_percent) == {*(f"y.{axis}" for axis in AXES), "average"}


def test_weight_zero_is_the_same_as_not_recorded(start, run):
    without, muted = identify(start, replace(run, i_c=None), weights="eq9"), identify(start, run, weights={"i_c": 0.0})
    assert_allclose(values(muted), values(without), rtol=1e-9)
    assert_allclose(errors(muted), errors(without), rtol=1e-9)


def test_weight_of_one_channel(bench, start, run):
    broken = run.i_c.copy()
    broken[:, 3] *= 2.0
    spoilt = replace(run, i_c=broken)
    assert held(identify(start, spoilt, weights="eq9"), bench.truth) < 7
    assert held(identify(start, spoilt, weights={"i_c.B_eta": 0.0}), bench.truth) >= 7


@pytest.mark.parametrize(
    ("choice", "left"),
    [
        ({"free": ["tau_e"]}, ["tau_e"]),
        ({"free": ["K_i"]}, NAMES[:4]),
        ({"free": ["K_s.A_*", "tau_e"]}, ["K_s.A_zeta", "K_s.A_eta", "tau_e"]),
        ({"fixed": ["K_i", "K_s.B_eta"]}, ["K_s.A_zeta", "K_s.A_eta", "K_s.B_zeta", "tau_e"]),
        ({"free": ["K_i.*"], "fixed": ["*.A_zeta"]}, NAMES[1:4]),
    ],
)
def test_only_the_free_parameters_move(bench, run, choice, left):
    model = Model(bench.rig())
    found = identify(model, run, **choice)
    assert list(found.parameters) == list(left)
    assert held(found, bench.truth) >= len(left) - 1
    others = [name not in left for name in NAMES]
    assert_array_equal(found.model.theta[others], model.theta[others])
    assert found.covariance.shape == (len(left), len(left))


def test_shared_parameters(i_e):
    bench = VirtualBench(K_i=(200.0, 200.0, 240.0, 240.0))
    record = bench.records(i_e, [4], period=510)[0]
    model = Model(bench.rig(off=0.05)).share("K_i.A", ["K_i.A_*"]).share("K_i.B", ["K_i.B_zeta", "K_i.B_eta"])
    found = identify(model, record)
    assert list(found.parameters) == ["K_i.A", "K_i.B", *NAMES[4:]]
    assert held(found, bench.truth | {"K_i.A": 200.0, "K_i.B": 240.0}) >= 6
    assert errors(found)[0] < identify(bench.rig(off=0.05), record).parameters["K_i.A_zeta"].std_error


def test_one_tau_e_per_axis(bench, start, run):
    found = identify(start.per_axis("tau_e"), run)
    own = [f"tau_e.{axis}" for axis in AXES]
    assert list(found.parameters) == [*NAMES[:8], *own]
    for name in own:
        assert_allclose(found.parameters[name].value, bench.tau_e, atol=4 * found.parameters[name].std_error)


def test_bounds_hold_and_are_reported(bench, run, golden):
    low = 1.02 * bench.tau_e
    start = Model(bench.rig()).with_values({"tau_e": 1.1 * bench.tau_e})
    found = identify(start, run, bounds={"tau_e": (low, 2e-3), "K_i": (100.0, 400.0)})
    assert found.status == "at_bound"
    assert_allclose(found.parameters["tau_e"].value, low, rtol=1e-6)
    (bound,) = (own for own in found.findings if own.code == "parameter_at_bound")
    assert bound.values["parameters"] == ["tau_e"]
    golden.holds(bound.line())


def test_bounds_that_do_not_bite_change_nothing(start, run, estimate):
    wide = identify(start, run, bounds={"K_i": (100.0, 400.0), "tau_e": (1e-5, 1e-2)})
    assert wide.status == "converged"
    assert_allclose(values(wide), values(estimate), rtol=1e-6)


@pytest.mark.slow
def test_several_records_are_pooled(bench, start, i_e):
    one, other = bench.records(i_e, [11, 12], period=510)
    first, second = identify(start, one), identify(start, other)
    both, turned = identify(start, [one, other]), identify(start, (other, one))
    assert_allclose(values(both), values(turned), rtol=1e-9)
    assert_allclose(values(both), 0.5 * (values(first) + values(second)), atol=0.2 * errors(both).min(), rtol=2e-4)
    assert_allclose(errors(both), errors(first) / np.sqrt(2.0), rtol=0.15)
    assert [len(y) for y in both.simulated] == [len(i_e)] * 2
    twice = identify(start, [one, one])
    assert_allclose(values(twice), values(first), rtol=1e-7)
    assert_allclose(twice.fit_percent["average"], first.fit_percent["average"], rtol=1e-6)


def test_a_value_that_misfit_has_driven_to_nothing_comes_back(start, run, estimate):
    """Steps are of the size that the rig file gives: those of the size of a value that is all but zero lead nowhere."""
    lost = start.with_values({"K_s.A_zeta": 1e-12})
    found = refit(compare(lost, run))
    assert_allclose([found.model[name].value for name in NAMES], values(estimate), rtol=1e-3)


def test_starts_find_the_same_optimum_and_their_seed_repeats_it(start, run, estimate):
    again = [identify(start, run, starts=3, seed=7) for _ in range(2)]
    assert_allclose(values(again[0]), values(estimate), rtol=1e-6)
    assert_array_equal(values(again[0]), values(again[1]))
    assert again[0].findings == again[1].findings
    (compared,) = (own for own in again[0].findings if own.code == "starts_compared")
    assert compared.values["starts"] == compared.values["same"] + compared.values["unstable"] == 3


def test_an_unstable_start_is_moved_and_noted(bench, run):
    slow = bench.rig().replace(actuator=Actuator(time_constant=4 * bench.tau_e))
    assert not Model(slow).is_stable
    found = identify(slow, run)
    assert found.status == "converged"
    assert held(found, bench.truth) >= 7
    (moved,) = (own for own in found.findings if own.code == "unstable_start")
    assert moved.values["factors"]["tau_e"] < 1.0


def test_a_loop_that_nothing_makes_stable_is_an_error(bench, run, golden):
    gains = {"proportional": 0.0, "integral": 0.0, "derivative": 0.0}
    off = bench.rig().replace(controller=bench.rig().controller.model_copy(update=gains))
    with golden.raises(UnstableLoopError):
        identify(off, run)


def test_an_axis_that_nothing_moves_is_not_identifiable(bench, start, i_e):
    """Excited along A_zeta only, the plane of the eta axes shows nothing but noise."""
    alone = i_e * [1.0, 0.0, 0.0, 0.0]
    record = bench.records(alone, [5], period=510)[0]
    found = identify(start, record)
    assert found.status == "not_identifiable"
    lost = {name for name in NAMES if "eta" in name and "zeta" not in name}
    assert {name for direction in found.directions for name in direction} == lost
    for name, p in found.parameters.items():
        assert (p.value is None) == (p.std_error is None) == (p.ci95 is None) == (name in lost)
    kept = replace(found, parameters={n: p for n, p in found.parameters.items() if n not in lost})
    assert held(kept, bench.truth) >= len(kept.parameters) - 1
    assert found.parameters["K_i.A_eta"].line() in str(found)
    plain = found.to_json()
    assert plain["parameters"]["K_i.A_eta"]["value"] is None
    assert plain["correlation"]["K_i.A_eta"]["tau_e"] is None


def test_evaluations_that_run_out(start, run, estimate):
    found = identify(start, run, max_evaluations=1)
    assert found.status == "max_evaluations"
    assert found.evaluations < estimate.evaluations
    assert found.fit_percent["average"] < estimate.fit_percent["average"]


def test_an_interrupt_keeps_the_best_so_far(start, run, estimate):
    costs = []

    def progress(evaluations, cost):
        costs.append(cost)
        if evaluations == 3:
            raise KeyboardInterrupt

    with pytest.raises(Stopped) as stopped:
        identify(start, run, progress=progress)
    found = stopped.value.result
    assert found.status == "stopped"
    assert len(costs) == found.evaluations == 3
    assert costs[2] < costs[0]
    assert_allclose(values(found), values(estimate), rtol=0.05)


def test_an_interrupt_before_or_after_a_descent_keeps_those_that_are_gone(start, run, monkeypatch):
    ends = []

    def alone(descent):
        if len(ends) == 2:
            raise KeyboardInterrupt
        ends.append(gone(descent))
        return ends[-1]

    gone = Descent.alone
    monkeypatch.setattr(Descent, "alone", alone)
    with pytest.raises(Stopped) as stopped:
        identify(start, run, starts=4)
    found = stopped.value.result
    assert found.status == "stopped"
    assert [dict(own.values) for own in found.findings if own.code == "stopped_at_start"] == [{"start": 2, "starts": 4}]
    assert_allclose(values(found), min(ends, key=lambda end: end.cost).theta[: len(values(found))])


def test_offsets_do_not_matter(start, run, estimate):
    lifted = replace(run, y=run.y + [3e-5, -2e-5, 1e-5, 0.0], i_c=run.i_c + [2.0, -1.0, 0.5, 0.0])
    found = identify(start, lifted)
    assert_allclose(values(found), values(estimate), rtol=1e-8)
    assert_allclose(errors(found), errors(estimate), rtol=1e-6)


def test_a_record_without_period(bench, start, run, estimate):
    """The noise is what no smooth response to i_e explains; its spectrum rests on fewer lines at each frequency."""
    found = identify(start, replace(run, period=None))
    assert held(found, bench.truth) >= 7
    assert_allclose(errors(found), errors(estimate), rtol=0.3)
    assert found.noise_ceiling_percent["average"] == pytest.approx(estimate.noise_ceiling_percent["average"], abs=0.1)


def test_nothing_given_is_changed(bench, i_e):
    measured = bench.records(i_e, [2])[0]
    excited, y, i_c = arrays = i_e.copy(), measured.y.copy(), measured.i_c.copy()
    copies = [array.copy() for array in arrays]
    record = Record("mine", 1e4, AXES, excited, y, i_c, period=510)
    model, bounds = Model(bench.rig(off=0.05)), {"K_i": (100.0, 400.0)}
    theta = model.theta.copy()
    identify(model, record, bounds=bounds, weights={"y": 2.0})
    for array, copy in zip(arrays, copies, strict=True):
        assert_array_equal(array, copy)
    assert_array_equal(model.theta, theta)
    assert bounds == {"K_i": (100.0, 400.0)}


def test_what_an_estimate_says(estimate):
    assert_allclose(np.diag(estimate.correlation), 1.0)
    assert np.all(np.abs(estimate.correlation) < 1.0 + 1e-12)
    assert_allclose(np.sqrt(np.diag(estimate.covariance)), errors(estimate))
    assert estimate.status in STATUS
    assert all(name in str(estimate) for name in (*NAMES, "f = K_i i + K_s s", "K_s > 0", "converged"))


@pytest.mark.parametrize(
    "arguments",
    [
        {"starts": 0},
        {"seed": -1},
        {"max_evaluations": 0},
        {"free": ["K_x"]},
        {"free": ["tau_e"], "fixed": ["tau_e"]},
        {"bounds": {"tau_e": (1e-3, 1e-4)}},
        {"bounds": {"tau_e": (1e-3, 1e-2)}},
        {"weights": {"x": 1.0}},
        {"weights": {"y": np.nan}},
    ],
    ids=lambda arguments: " ".join(f"{name} {value}" for name, value in arguments.items()).replace("'", ""),
)
def test_wrong_requests(start, run, arguments, golden):
    with golden.raises(ModelError):
        identify(start, run, **arguments)


def test_wrong_records(start, run, golden):
    with golden.raises(RecordError):
        identify(start, [])
    with golden.raises(RecordError):
        identify(start, replace(run, axes=AXES[::-1]))
    with pytest.raises(RecordError, match="20000 Hz"):
        identify(start, replace(run, sample_rate=2e4))
    with golden.raises(RecordError):
        identify(start, replace(run, i_e=None))


def test_a_rough_descent_halves_no_steps_that_friction_needs():
    """As steep as this it needs 32 steps per sample: with 16 its loop grows without bound."""
    own = {"coulomb_friction.force": 0.5, "coulomb_friction.inverse_width": 1e7}
    model = Model(ONE_AXIS.rig).add("coulomb_friction").with_values(own).with_substeps(32)
    record = model.virtual_experiment(ONE_AXIS.excitation(1.0), seed=1)
    with pytest.raises(UnstableLoopError):
        model.with_substeps(16).simulate(record.i_e)
    assert refit(compare(model, record), step=ROUGHLY).misfit < 1.05
