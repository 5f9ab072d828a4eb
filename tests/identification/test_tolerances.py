"""Where the rig file is off by ordinary tolerances the model is right, and total intervals hold the truth."""

import numpy as np
import pytest

from ambid import Rig, diagnose, identify, prbs
from ambid._core import fit_all
from ambid.diagnosis import compare
from ambid.identification.covariance import covariance
from ambid.identification.many import fit_for_core
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import Descent
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.tolerances import TABLE, machine_off, measured_off
from places import LEVITATOR

ONE_AXIS = {"K_i": [165.0], "K_s": [1.1e6], "tau_e": 2.4e-4}


def found(rig, machine, i_e, seed, **noise):
    """The estimate of a machine that is off, and how far each parameter is from the truth in standard errors."""
    known, record = measured_off(rig, i_e, seed, **machine, **noise)
    estimate = identify(known, record)
    truth = {
        f"{kind}.{axis}": value for kind in ("K_i", "K_s") for axis, value in zip(rig.axes, machine[kind], strict=True)
    } | {"tau_e": machine["tau_e"]}
    own = estimate.parameters
    return estimate, {name: (own[name].value - value) / own[name].std_error for name, value in truth.items()}


def of_levitator(seed):
    i_e = prbs(8, amplitude=0.2, hold=2, axes=1, periods=8, seed=seed)
    return found(Rig.load(LEVITATOR), ONE_AXIS, i_e, seed, sensor_noise=30e-9, current_noise=2e-3)


def of_bench(seed):
    bench = BENCHES["bench"]
    i_e = prbs(7, amplitude=bench.amplitude, hold=bench.hold, axes=4, periods=4, seed=seed)
    return found(bench.rig, bench.truth, i_e, seed, **bench.noise)


@pytest.mark.parametrize(
    ("drawn", "seeds"),
    [
        pytest.param(of_levitator, range(5), id="one axis"),
        pytest.param(of_levitator, range(100, 150), id="one axis, many", marks=pytest.mark.slow),
        pytest.param(of_bench, range(4), id="four axes", marks=pytest.mark.slow),
    ],
)
def test_total_intervals_hold_the_truth_and_the_model_is_adequate(drawn, seeds):
    each = [drawn(seed) for seed in seeds]
    assert all(estimate.is_adequate for estimate, _ in each), [estimate.misfit for estimate, _ in each]
    inside = np.mean([[abs(z) < 1.96 for z in off.values()] for _, off in each])
    assert inside > 0.95 - 3.0 * np.sqrt(0.05 * 0.95 / len(seeds))
    alone = [estimate.parameters["K_i.A_zeta"] for estimate, _ in each]
    assert all(p.std_error > 3.0 * p.std_error_statistical for p in alone)


def test_a_tolerance_that_the_record_feels_is_found():
    bench = BENCHES["bench"]
    i_e = prbs(8, amplitude=bench.amplitude, hold=bench.hold, axes=4, periods=3)
    slower = bench.rig.amplifier.model_copy(update={"time_constant": 1.04 * bench.rig.amplifier.time_constant})
    record = simulate(bench.rig.replace(amplifier=slower), i_e, seed=1, **bench.truth, **bench.noise)
    estimate = identify(bench.rig.replace(tolerance=TABLE), record)
    own = [estimate.tolerances[f"amplifier_time_constant.{axis}"] for axis in bench.rig.axes]
    assert [p.posterior_value for p in own] == pytest.approx([0.04] * 4, abs=0.005)
    assert all(p.posterior_std < 0.2 * p.std for p in own)
    assert estimate.is_adequate


def test_an_exact_rig_file_is_fitted_as_before(rig, run):
    exact, without = identify(rig.replace(tolerance={"mass": 0.01}).exact(), run), identify(rig, run)
    assert exact.to_json()["parameters"] == without.to_json()["parameters"]
    assert not exact.tolerances


def test_variances_are_the_sum_of_their_budget(rig, run):
    estimate = identify(rig.replace(tolerance={}), run)
    budget = estimate.budget()
    for name, p in estimate.parameters.items():
        assert sum(budget[name].values()) == pytest.approx(p.std_error**2, rel=1e-6)
        assert budget[name]["noise"] == pytest.approx(p.std_error_statistical**2, rel=1e-9)


@pytest.mark.slow
def test_what_an_effect_leaves_is_no_evidence_of_errors_of_the_rig_file():
    """The effect is named alone, and the values of the rig file stay what they are known to be until it is added."""
    rig = Rig.load(LEVITATOR).replace(tolerance={})
    i_e = prbs(8, amplitude=0.2, hold=2, axes=1, periods=8)
    late = {"loop_delay": {"seconds": 8e-5}}
    own = {**ONE_AXIS, "sensor_noise": 30e-9, "current_noise": 2e-3}
    train, validate = (simulate(rig, level * i_e, late, seed=seed, **own) for seed, level in ((1, 1.0), (2, 0.8)))
    without = identify(rig, train)
    assert without.misfit > 20.0
    assert all(abs(known.posterior_value) < 2.5 * known.std for known in without.tolerances.values())
    found = diagnose(rig, train, validate=validate)
    assert (found.verdict, found.effects) == ("explained", ("loop_delay",))
    assert found.parameters["loop_delay.delay"].ci95[0] < 8e-5 < found.parameters["loop_delay.delay"].ci95[1]


def test_the_core_goes_down_as_scipy_does():
    rig = Rig.load(LEVITATOR).replace(tolerance={})
    i_e = prbs(8, amplitude=0.2, hold=2, axes=1, periods=8)
    record = simulate(rig, i_e, {"loop_delay": {"seconds": 2e-5}}, seed=1, **ONE_AXIS)
    comparison = compare(rig, record)
    problem = WhitenedProblem(comparison.model, comparison.noise)
    limits = tuple(np.array([getattr(p, side) for p in comparison.model.parameters]) for side in ("lower", "upper"))
    descent = Descent(problem, problem.model.theta / problem.scale, tuple(own / problem.scale for own in limits), 50)
    (ended,) = fit_all([fit_for_core(descent)])
    alone = descent.alone()
    spread = np.sqrt(np.diag(covariance(comparison.of(comparison.model.with_theta(alone.theta)), problem.free)))
    assert ended["cost"] > 1.5 * comparison.dof
    assert np.abs((ended["theta"] - alone.theta) / spread).max() < 0.1


def test_tolerances_stay_where_physics_is_missing_and_the_noise_is_not_measured():
    rig = Rig.load(LEVITATOR).replace(tolerance={})
    i_e = prbs(7, amplitude=0.2, hold=2, axes=1, periods=4)
    own = {**ONE_AXIS, "sensor_noise": 30e-9, "current_noise": 2e-3}
    estimate = identify(rig, simulate(rig, i_e, {"loop_delay": {"seconds": 8e-5}}, seed=1, **own))
    assert {"noise_not_separable", "intervals_widened"} <= {finding.code for finding in estimate.findings}
    assert {name.partition(".")[0] for name in estimate.tolerances} >= {"mass", "sensor_gain", "current_gain"}
    for name, p in estimate.parameters.items():
        assert sum(estimate.budget()[name].values()) == pytest.approx(p.std_error**2, rel=1e-6)
        assert p.std_error > p.std_error_statistical


def test_tolerances_stay_where_the_noise_is_not_known():
    """Eq. 9 moves with an error of the rig file by what its intervals are widened by."""
    rig = Rig.load(LEVITATOR).replace(tolerance={})
    i_e = prbs(7, amplitude=0.2, hold=2, axes=1, periods=1)
    record = simulate(rig, i_e, seed=1, **ONE_AXIS, sensor_noise=30e-9, current_noise=2e-3, period=len(i_e))
    estimate = identify(rig, record)
    assert "noise_unknown" in {finding.code for finding in estimate.findings}
    budget = estimate.budget()
    heavier = rig.replace(rotor=rig.rotor.model_copy(update={"mass": rig.rotor.mass * (1.0 + 1e-4)}))
    other = identify(heavier, record)
    for name, p in estimate.parameters.items():
        assert sum(budget[name].values()) == pytest.approx(p.std_error**2, rel=1e-6)
        assert budget[name]["noise"] == pytest.approx(p.std_error_statistical**2, rel=1e-6)
        by_mass = abs(other[name].value - p.value) / 1e-4 * estimate.tolerances["mass"].std
        assert np.sqrt(budget[name]["mass"]) == pytest.approx(by_mass, rel=0.05, abs=0.01 * p.std_error)


@pytest.mark.slow
def test_records_without_periods_lead_to_the_optimum_of_a_rig_file_that_is_off():
    bench, seed = BENCHES["small"], 46
    off = machine_off(bench.rig, seed)
    record = off.record(bench.excitation(bench.amplitude, 2 * seed), 2 * seed, **bench.truth, **bench.noise)
    assert record.period is None
    estimate = identify(off.known, record)
    assert estimate.is_adequate
    assert estimate.tolerances
