"""The budget of the fast tier: what is counted, with which test, and what becomes of a run that passes it."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from ambid import Model
from budget import BUDGETS, EVALUATIONS, METER, PICTURES, Ledger, Meter, evaluations_of


def report(name, **cost):
    """The last report of a test."""
    made = pytest.TestReport(name, ("tests/test_a.py", 1, name), {}, "passed", None, "teardown", duration=0.5)
    made.cost = {name: {what.replace("_", " "): number for what, number in cost.items()}}
    return made


@pytest.fixture
def spent():
    """What the meter of this process has charged since."""
    before = METER.take()
    yield METER.take
    for account, own in before.items():
        with METER.account(account):
            for what, number in own.items():
                METER.charge(what, number)


def test_evaluations_of_the_core_and_pictures_are_counted(spent, rig, tmp_path):
    model = Model(rig)
    spent()
    model.poles()
    model.simulate(np.zeros((10, 4)))
    Figure().savefig(tmp_path / "a.png")
    (own,) = spent().values()
    assert (own[EVALUATIONS], own[PICTURES]) == (2, 1)


def test_many_fits_count_each_of_their_evaluations():
    assert evaluations_of([{"evaluations": 7}, {"evaluations": 5}, ValueError()]) == 13
    assert evaluations_of([1.0, 2.0]) == 1


def test_what_a_shared_fixture_costs_is_its_own():
    meter = Meter()
    with meter.account("test"):
        meter.charge("evaluations", 2)
        with meter.account("fixture"):
            meter.charge("evaluations", 40)
        meter.charge("evaluations", 1)
    assert {name: own["evaluations"] for name, own in meter.take().items() if "evaluations" in own} == {
        "test": 3,
        "fixture": 40,
    }


@pytest.mark.parametrize("dear", [0, 1])
def test_a_test_that_costs_too_much_is_named(dear):
    ledger = Ledger(judges=True)
    ledger.pytest_runtest_logreport(report("cheap", evaluations=1))
    ledger.pytest_runtest_logreport(report("dear", evaluations=BUDGETS[EVALUATIONS].one + dear))
    assert [line.partition(":")[0] for line in ledger.passed()] == ["dear"] * dear


@pytest.mark.parametrize("more", [0, 1])
def test_a_run_that_costs_too_much_is_told(more):
    budget = BUDGETS[EVALUATIONS]
    count = budget.all // budget.one
    ledger = Ledger(judges=True)
    for k in range(count + more):
        ledger.pytest_runtest_logreport(report(f"test_{k}", evaluations=budget.one))
    assert len(list(ledger.passed())) == more


def test_what_two_workers_make_counts_once():
    ledger = Ledger(judges=True)
    for number in (30, 31):
        ledger.pytest_runtest_logreport(report("fixture", evaluations=number))
    assert ledger.costs["fixture"]["evaluations"] == 31
