"""What the tests of the workbench share: a hidden delay of a mass on one axis, and the chain that finds it."""

import pytest

import ambid
from ambid.workbench import Bench, Session
from hidden.one_axis import ONE_AXIS, record

HIDDEN = {"loop_delay": {"seconds": 5e-5}}


@pytest.fixture(scope="package")
def begun():
    train, kept = record(HIDDEN, seed=1), record(HIDDEN, seed=2, share=0.5)
    return Session.begin(Bench(ambid.Model(ONE_AXIS.rig), (train,), (kept,)))


@pytest.fixture(scope="package")
def fitted(begun):
    return begun.fit().ranked()


@pytest.fixture(scope="package")
def added(fitted):
    return fitted.add("loop_delay")
