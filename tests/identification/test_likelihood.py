"""The fit that minimises J: intervals that hold for whole and for cut records, repeatable to the last bit."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2

from ambid import Rig, prbs
from ambid.errors import ModelError
from ambid.identification import identify
from ambid.model import Model
from hidden.bench import measured, simulate
from hidden.families import BENCHES
from hidden.null_cells import made
from hidden.one_axis import ONE_AXIS
from places import LEVITATOR
from tiers import first_fast
from virtual import NAMES

LEAST, MOST = chi2.ppf([5e-4, 1 - 5e-4], 40) / 40


def values(estimate) -> np.ndarray:
    return np.array([p.value for p in estimate.parameters.values()])


def errors(estimate) -> np.ndarray:
    return np.array([p.std_error for p in estimate.parameters.values()])


def cut(record, first, samples):
    """A part of a record, which begins in the middle of what happens."""
    part = slice(first, first + samples)
    i_c = None if record.i_c is None else record.i_c[part]
    return replace(record, i_e=record.i_e[part], y=record.y[part], i_c=i_c)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cut_at", "weights", "with_i_c"),
    [
        pytest.param(388, "likelihood", True, id="cut"),
        pytest.param(None, "eq9", False, id="whole by eq. 9, y alone"),
        pytest.param(None, "likelihood", False, id="whole, y alone"),  # with i_c: test_closed_loop
    ],
)
def test_estimates_scatter_as_their_standard_errors_say(bench, cut_at, weights, with_i_c):
    """The mean of squares of 40 numbers of unit variance lies between `LEAST` and `MOST`, but for one in 1000."""
    truth, start, found = np.array(list(bench.truth.values())), Model(bench.rig(off=0.02)), []
    i_e = prbs(7, amplitude=0.15, hold=2, axes=4, periods=6)
    for record in bench.records(i_e, range(2000, 2040), period=254):
        part = record if cut_at is None else cut(record, cut_at, 4 * 254)
        estimate = identify(start, part if with_i_c else replace(part, i_c=None), weights=weights)
        found.append((values(estimate) - truth) / errors(estimate))
    z = np.array(found)
    assert np.all(np.abs(z.mean(axis=0)) < 4.0 / np.sqrt(len(z)))
    squares = np.mean(z**2, axis=0)
    assert np.all((squares > LEAST) & (squares < MOST)), squares


@pytest.mark.parametrize("own", first_fast([ONE_AXIS, BENCHES["bench"]]), ids=["one axis", "two bearings"])
def test_a_record_cut_anywhere_gives_the_truth_and_a_misfit_of_one(own):
    axes = own.rig.axes
    names = [*(f"K_i.{axis}" for axis in axes), *(f"K_s.{axis}" for axis in axes), "tau_e"]
    truth = dict(zip(names, (*own.K_i, *own.K_s, own.tau_e), strict=True))
    for seed in range(10):
        random = np.random.default_rng(100 + seed)
        whole = simulate(own.rig, own.excitation(own.amplitude), seed=seed, **own.truth, **own.noise, period=own.period)
        first = int(random.integers(1, own.period))
        part = cut(whole, first, int(random.integers(2 * own.period, whole.samples - first + 1)))
        found = identify(own.rig, part)
        assert found.misfit == pytest.approx(1.0, abs=0.05), (first, part.samples)
        for name, p in found.parameters.items():
            assert abs(p.value - truth[name]) < 4.5 * p.std_error, (name, first, part.samples)


def test_twice_is_the_same_to_the_last_bit(bench, run):
    one, other = (identify(bench.rig(off=0.08), run) for _ in range(2))
    assert_array_equal(values(one), values(other))
    assert_array_equal(one.covariance, other.covariance)
    assert (one.misfit, one.evaluations, one.fit_percent) == (other.misfit, other.evaluations, other.fit_percent)


def test_it_ends_with_a_verdict_and_what_to_do_next(bench, i_e, run):
    right = identify(bench.rig(off=0.02), run)
    assert right.is_adequate
    assert right.misfit < right.misfit_bound
    assert right.inconsistency is None
    assert right.next_step.code == "next_validate"
    (slow,) = replace(bench, tau_a=bench.tau_a + 1e-5).records(i_e, [1], period=510)
    wrong = identify(bench.rig(), slow)
    assert not wrong.is_adequate
    assert wrong.inconsistency.code == "misfit_above_limit"
    assert wrong.inconsistency.values == {"misfit": wrong.misfit, "limit": wrong.misfit_bound}
    assert wrong.next_step.code == "next_diagnose"
    assert [own.code for own in wrong.findings] == ["noise_arises", "intervals_widened"]
    for estimate in (right, wrong):
        content = estimate.to_json()
        assert (content["misfit"], content["misfit_bound"]) == (estimate.misfit, estimate.misfit_bound)
        assert (content["adequate"], content["next"]) == (estimate.is_adequate, estimate.next)
        assert content["next_step"]["code"] == estimate.next_step.code
        assert [own["code"] for own in content["findings"]] == [own.code for own in estimate.findings]
        assert estimate.verdict in str(estimate)
        assert f"next: {estimate.next}" in str(estimate)


def test_what_is_within_the_bound_and_above_chance_is_called_good_enough(golden):
    """An amplifier that is 2 us slower than the rig says, in a record long enough for chance to bring 1.05 alone."""
    rig = Rig.load(LEVITATOR)
    slower = rig.amplifier.model_copy(update={"time_constant": rig.amplifier.time_constant + 2e-6})
    i_e = prbs(13, amplitude=0.3, axes=1, periods=3)
    record = Model(rig.replace(amplifier=slower)).virtual_experiment(i_e, seed=1)
    found = identify(rig, replace(record, period=8191))
    assert found.is_adequate
    assert found.comparison.by_chance < found.misfit < found.misfit_bound
    golden.holds(found.verdict)


def test_where_misfit_is_left_the_intervals_are_wider(bench, i_e):
    (slow,) = replace(bench, tau_a=bench.tau_a + 1e-5).records(i_e, [1], period=510)
    left = identify(bench.rig(), slow)
    assert left.misfit > 1.2
    hessian = left.comparison.noise.quadratic(left.model, range(len(NAMES))).hessian
    if_nothing_were_missing = np.sqrt(np.diag(np.linalg.inv(hessian)))
    assert np.all(errors(left) > 0.999 * np.sqrt(left.misfit) * if_nothing_were_missing)


def test_it_is_at_the_minimum_of_j(bench, run):
    found = identify(bench.rig(off=0.05), run)
    own = found.comparison
    for k, error in enumerate(errors(found)):
        for step in (-0.3, 0.3):
            theta = found.model.theta
            theta[k] += step * error
            assert own.of(found.model.with_theta(theta)).cost > own.cost


def test_without_periods_it_is_at_the_minimum_of_j_in_the_noise_that_it_leaves():
    """That noise comes from the residual, which changes as the fit goes on."""
    bench, first, samples = BENCHES["bench"], 1575, 4442
    i_e = prbs(9, amplitude=bench.amplitude, hold=5, axes=4, periods=4, seed=68)
    record = cut(measured(bench.rig, i_e, {}, seed=68, **bench.truth, **bench.noise), first, samples)
    found = identify(Model(bench.rig), replace(record, period=None))
    truth = dict(zip(found.parameters, [*bench.truth["K_i"], *bench.truth["K_s"], bench.truth["tau_e"]], strict=True))
    fit = found.comparison
    behind = fit.of(fit.model.with_values(truth)).cost - fit.cost
    assert 0.0 < behind < chi2.ppf(1.0 - 1e-4, len(truth)), behind


def test_a_transient_is_no_noise_where_a_fit_begins():
    """A rotor that is hardly damped, three periods long: between their lines the transient is the loudest."""
    assert identify(*made(187)).misfit < 1.1


def test_a_start_elsewhere_ends_at_the_same_place(bench, run):
    """Within a hundredth of a standard error; the noise is that of the residual near the end."""
    one, other = (identify(bench.rig(off=off), run) for off in (0.02, -0.08))
    assert_allclose((values(one) - values(other)) / errors(one), 0.0, atol=0.01)


EQ_9 = {
    "K_i.A_zeta": 217.26723656049734,
    "K_i.A_eta": 224.95099265275135,
    "K_i.B_zeta": 277.8139802281981,
    "K_i.B_eta": 284.8905928088693,
    "K_s.A_zeta": 2396067.309603036,
    "K_s.A_eta": 2478325.782907838,
    "K_s.B_zeta": 3127353.14041436,
    "K_s.B_eta": 3211280.837017445,
    "tau_e": 0.0002493460694623987,
}
"""Of the demo's record, from before J was the yardstick."""


def test_weights_of_eq_9_give_what_they_always_gave(demo_rig, demo_record, demo_truth):
    found = identify(demo_rig, demo_record, weights="eq9")
    assert_allclose(values(found), [EQ_9[name] for name in NAMES], rtol=1e-6)
    assert sum(abs(p.value - demo_truth[name]) < 1.96 * p.std_error for name, p in found.parameters.items()) >= 8
    again = identify(demo_rig, demo_record, weights={"y": 1.0, "i_c": 1.0})
    assert_array_equal(values(again), values(found))


def test_the_likeliest_is_at_least_as_sharp_as_eq_9(demo_estimate, demo_rig, demo_record):
    assert np.all(errors(demo_estimate) < 1.1 * errors(identify(demo_rig, demo_record, weights="eq9")))


def test_wrong_weights(bench, run, golden):
    with golden.raises(ModelError):
        identify(bench.rig(), run, weights="ml")
    with golden.raises(ModelError):
        identify(bench.rig(), run, weights={"y": 0.0, "i_c": 0.0})


def test_where_the_noise_is_not_known_it_is_eq_9_and_a_finding_has_why(bench, i_e):
    (quiet,) = bench.records(i_e[:40], [0])
    found, plain = (identify(bench.rig(), quiet, weights=weights) for weights in ("likelihood", "eq9"))
    assert [own.code for own in found.findings] == ["noise_unknown"]
    assert_array_equal(values(found), values(plain))
    assert np.isnan(found.misfit)
    assert found.next_step.code == "next_record_periods"
