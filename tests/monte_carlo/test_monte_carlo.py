"""Monte Carlo: runs that depend on nothing but the plan and their number, and figures that are right."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.errors import InputError, ModelError
from ambid.identification import identify
from ambid.monte_carlo import Spread, run_monte_carlo
from ambid.monte_carlo.result import RUNS_FAILED, MonteCarlo
from monte_carlo.planned import RIG, plan

RUNS = 28


@pytest.fixture(scope="module")
def found():
    return run_monte_carlo(plan(), RUNS)


def test_right_models_are_judged_right(found):
    assert found.status == {"converged": RUNS}
    assert found.adequate > 0.97
    for accuracy in found.parameters.values():
        assert abs(accuracy.bias) < 4.0 * accuracy.bias_std_error
        assert accuracy.spread == pytest.approx(accuracy.std_error, rel=4.0 / np.sqrt(2.0 * RUNS))
        assert accuracy.coverage > 0.95 - 4.0 * np.sqrt(0.05 * 0.95 / RUNS)
    assert np.allclose(np.diag(found.correlation), 1.0)


def test_a_run_can_be_made_again_by_hand(found):
    row = found.rows[17]
    own = plan()
    record = own.machine.virtual_experiment(own.excitation, seed=row["seed"])
    single = identify(RIG, replace(record, period=127 * 4))
    for name, p in single.parameters.items():
        assert row[f"{name}.value"] == pytest.approx(p.value, abs=1e-6 * p.std_error)
        assert row[f"{name}.std_error"] == pytest.approx(p.std_error, rel=1e-6)


def test_a_run_is_the_same_among_fewer(found):
    assert list(found.rows[:3]) == list(run_monte_carlo(plan(), 3).rows)


def test_another_seed_gives_other_runs(found):
    assert run_monte_carlo(plan(seed=5), 1).rows[0]["seed"] != found.rows[0]["seed"]


def test_spreads_are_drawn_and_told():
    spreads = [Spread.parse(text) for text in ("K_i=normal:2%", "amplitude=uniform:0.5:2", "rotor.mass=uniform:1%")]
    own = plan(spreads=tuple(spreads))
    truths = [own.of_run(run) for run in range(40)]
    k_i = np.array([truth.model.parameters[0].value for truth in truths]) / own.machine.parameters[0].value
    assert 0.01 < k_i.std() < 0.03
    amplitude, mass = (np.array([truth.drawn[key] for truth in truths]) for key in ("amplitude", "rotor.mass"))
    assert 0.5 < amplitude.min() < 0.8 < 1.6 < amplitude.max() < 2.0
    assert np.abs(mass / 12.0 - 1.0).max() < 0.01
    assert len(set(mass)) == 40
    for row, truth in zip(run_monte_carlo(own, 3).rows, truths[:3], strict=True):
        assert row["K_i.A_zeta.true"] == truth.model.parameters[0].value
        assert [row[f"drawn.{key}"] for key in own.drawn] == [truth.drawn[key] for key in own.drawn]


@pytest.mark.slow
def test_values_that_are_known_to_a_tolerance_are_off_in_every_run():
    runs = 120
    own = plan(rig=RIG.replace(tolerance={}))
    for name, std in (("mass", 0.005), ("sensor_gain.A_zeta", 0.01)):
        drawn = np.array([own.of_run(run).drawn[name] for run in range(400)])
        assert drawn.std() == pytest.approx(std, rel=4.0 / np.sqrt(2.0 * 400))
    found = run_monte_carlo(own, runs)
    assert found.rows[-1]["drawn.mass"] == own.of_run(runs - 1).drawn["mass"]
    assert found.adequate > 0.93
    for accuracy in found.parameters.values():
        assert accuracy.coverage > 0.95 - 4.0 * np.sqrt(0.05 * 0.95 / runs)
        assert accuracy.spread == pytest.approx(accuracy.std_error, rel=6.0 / np.sqrt(2.0 * runs))


def test_a_value_of_the_rig_that_is_drawn_is_the_truth():
    own = plan(spreads=(Spread.parse("actuator.time_constant=normal:3%"),))
    truth = own.of_run(2)
    (tau_e,) = (p.value for p in truth.model.parameters if p.name == "tau_e")
    assert tau_e == truth.drawn["actuator.time_constant"] != RIG.actuator.time_constant


def test_what_is_hidden_biases():
    hidden = ambid.Model(RIG).add("loop_delay", {"delay": 2e-5})
    found = run_monte_carlo(plan(truth=hidden), 8)
    assert found.adequate < 0.5
    assert found.parameters["tau_e"].coverage < 0.5


@pytest.mark.slow
def test_diagnoses_are_counted():
    hidden = ambid.Model(RIG).add("sensor_lag", {"time_constant": 5e-5})
    found = run_monte_carlo(plan(truth=hidden, diagnose=True), 2)
    assert sum(found.verdicts.values()) == 2
    assert found.truth_named == 1.0
    assert found.named["sensor_lag"] == 2


def test_a_failed_run_is_a_row():
    found = run_monte_carlo(plan(spreads=(Spread.parse("K_s=uniform:0.5:2e8"),)), 12)
    assert len(found.rows) == 12
    assert found.status["failed"] >= 6
    counts = [own.values["failed"] for own in found.findings if own.kind is RUNS_FAILED]
    assert counts == list(found.reasons.values())[:3]
    failed = next(row for row in found.rows if row["status"] == "failed")
    assert np.isnan(failed["tau_e.value"])
    assert failed["K_s.A_zeta.true"] > 0.0
    assert all(line in str(found) for line in found.finding_lines())


@pytest.mark.parametrize("spread", ["K_i=uniform:-2:-1", "rotor.mass=uniform:-2:-1"])
def test_what_cannot_be_is_a_row(spread):
    found = run_monte_carlo(plan(spreads=(Spread.parse(spread),)), 2)
    assert found.status == {"failed": 2}
    assert all(found.reasons)


def test_no_run_is_enough_for_no_figure():
    empty = MonteCarlo.of(plan(), [])
    assert empty.parameters["tau_e"].runs == 0
    assert empty.to_json()["adequate"] is None


def test_a_plan_goes_to_other_processes():
    hidden = ambid.Model(RIG).add("sensor_lag", {"time_constant": 5e-5})
    own = plan(truth=hidden, spreads=(Spread.parse("K_i=normal:1%"),))
    again = pickle.loads(pickle.dumps(own))
    assert again.content() == own.content()
    assert run_monte_carlo(again, 2).rows == run_monte_carlo(own, 2).rows


@pytest.mark.parametrize(
    "text",
    [
        "K_i",
        "=normal:1",
        "K_i=cauchy:1",
        "K_i=normal:1:2",
        "K_i=normal:wide",
        "K_i=normal:-1",
        "K_i=uniform:2:1",
        "K_i=normal:nan",
    ],
)
def test_a_spread_that_cannot_be_read(text, golden):
    with golden.raises(InputError):
        Spread.parse(text)


def test_a_key_that_is_nowhere(golden):
    with golden.raises(ModelError):
        plan(spreads=(Spread.parse("K_x=normal:1%"),))


@pytest.mark.parametrize("change", [{"seed": -1}, {"excitation": np.ones((9, 2))}], ids=["seed", "excitation"])
def test_a_plan_that_does_not_fit(change, golden):
    with golden.raises(InputError):
        plan(**change)


def test_no_runs(golden):
    with golden.raises(InputError):
        run_monte_carlo(plan(), 0)
