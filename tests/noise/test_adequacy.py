"""Every test that a model must pass, held against the distributions of SciPy and against Holm's adjusted p-values."""

import numpy as np
import pytest
from scipy import stats

from ambid import Model, compare, identify
from ambid.noise import Adequacy, Criterion
from ambid.noise.adequacy import misfit_criterion
from ambid.noise.chance import ADEQUATE, RARE
from hidden.one_axis import ONE_AXIS, record
from validated import relative


@pytest.mark.parametrize("trials", [1.0, 8.0])
def test_limit_and_p_value_are_those_of_chi_squared_and_of_f(trials, validated):
    for statistic in (0.7, 1.3, 2.5):
        alone = Criterion("power", statistic, 40.0, trials=trials)
        beside = Criterion("motion", statistic, 40.0, 90.0, trials=trials)
        limits = stats.chi2.isf(RARE / trials, 40) / 40, stats.f.isf(RARE / trials, 40, 90)
        tails = np.array([stats.chi2.sf(40 * statistic, 40), stats.f.sf(statistic, 40, 90)])
        found = [alone.by_chance, beside.by_chance, alone.p_value, beside.p_value]
        validated(
            "Limits and p-values of tests of adequacy: relative error",
            "chi-squared and F distributions of SciPy {scipy}",
            relative(found, [*limits, *np.minimum(1.0, trials * tails)]),
            1e-6,
        )


def test_two_models_that_differ_are_told_apart_as_the_worst_difference_allows():
    """J1 - J2 of two models, the first of them right, has the mean -lambda and the variance 4 lambda."""
    fall, apart = 12.0, np.linspace(0.1, 60.0, 2000)
    worst = stats.norm.sf((fall + apart) / (2.0 * np.sqrt(apart))).max()
    assert Criterion("curvature", fall, 1.0, trials=0.5).p_value == pytest.approx(worst, rel=1e-4)


@pytest.mark.parametrize("seed", range(20))
def test_as_many_fail_as_by_the_adjusted_p_values_of_holm(seed):
    random = np.random.default_rng(seed)
    p = 10.0 ** random.uniform(-5.0, -2.0, 6)
    tests = [Criterion("power", stats.chi2.isf(own, 30) / 30, 30.0) for own in p]
    ordered = np.sort(p)
    adjusted = np.maximum.accumulate((len(p) - np.arange(len(p))) * ordered)
    found = Adequacy().beside(*tests)
    assert len(found.failed()) == np.sum(adjusted < RARE)
    assert [own.p_value for own in found.tests] == pytest.approx(ordered)
    assert Adequacy().beside(*tests[:2]).beside(*tests[2:]) == found


def test_what_does_not_matter_fails_nothing_however_sure_and_counts_last():
    small = Criterion("power", 1.09, 1e6, least=ADEQUATE)
    unlikely = Criterion("motion", stats.chi2.isf(0.6 * RARE, 30) / 30, 30.0)
    assert not Adequacy().beside(small, unlikely).failed()
    assert Adequacy().beside(unlikely).failed()


def test_the_misfit_keeps_its_level_and_dear_tests_are_made_where_it_is_within():
    def dear():
        made.append(1)
        yield Criterion("shape", 1.0, 4.0)

    for misfit, count in ((1.3, 0), (1.05, 1)):
        made: list[int] = []
        found = Adequacy.of([misfit_criterion(misfit, 1000, spread=1.5)], dear())
        assert len(made) == count
        assert found.is_adequate == (count == 1)
        assert found.bound == pytest.approx(stats.chi2.isf(RARE, 1000 / 2.25) / (1000 / 2.25))


def test_without_a_test_no_model_is_adequate():
    assert not Adequacy().is_adequate
    assert np.isnan(Adequacy().bound)
    assert Adequacy().finding is None


def test_results_have_the_tests_that_were_made_worst_first():
    seed = 2
    periodic = record({}, seed)
    random = np.random.default_rng(seed).choice([-1.0, 1.0], (500, 1))
    found = identify(ONE_AXIS.rig, periodic)
    assert [own["test"] for own in found.to_json()["adequacy"]] == ["misfit"]
    wrong = Model(ONE_AXIS.rig).with_values({"K_i.A_zeta": 1.3 * ONE_AXIS.K_i[0]})
    (failed,) = compare(wrong, periodic).to_json()["adequacy"]
    assert failed["statistic"] > failed["limit"]
    assert failed["p_value"] < RARE
    once = found.model.virtual_experiment(np.repeat(0.3 * random, 4, axis=0), sensor_noise=1e-7, current_noise=1e-3)
    tests = compare(found.model, once).to_json()["adequacy"]
    assert {own["test"] for own in tests} >= {"misfit", "power", "shape"}
    assert all(own["statistic"] <= own["limit"] for own in tests)
    assert {own["where"] for own in tests if own["test"] == "shape"} == {once.name}
