"""Loops whose poles are hard to come by: an answer or an error, and soon."""

from time import process_time

import numpy as np
import pytest

from ambid import Model, Rig
from ambid.demo import DATA
from ambid.errors import AmbidError, ModelError, RigError, UnstableLoopError
from ambid.rig.controller import StateSpaceController, TransferFunctionController
from ambid.rig.fields import MOST
from ambid.threads import with_one_blas_thread

SOON = 1.0
"""Seconds of the processor; what is tried takes some tenths of it, or for ever."""


def demo_with(**controller):
    rig = Rig.load(DATA / "rig.toml")
    return rig.replace(controller=rig.controller.model_copy(update=controller))


@with_one_blas_thread
def answers(model):
    """What the loop answers or raises, one word a question, and the seconds that all of them take."""
    points = np.exp(1j * np.linspace(0.1, 3.0, 20))
    questions = (
        model.poles,
        lambda: model.loop.transfer(model.theta, points),
        lambda: model.loop.simulate(model.theta, np.zeros((50, len(model.loop.inputs)))),
    )
    found, start = [], process_time()
    for question in questions:
        try:
            answer = question()
            found.append(bool((np.isfinite(answer) | (answer == -np.inf)).all()))  # -inf: gone within a sample
        except AmbidError as error:
            found.append(type(error))
    return found, process_time() - start


@pytest.mark.parametrize(
    ("delay", "factor"),
    [(15.0, 1.25), (16.0, 1.25), (17.0, 1.25), (18.0, 1.25), (20.0, 1.25), (15.5, 1.4378941112243542), (40.0, 1.25)],
)
def test_commands_under_way_do_not_make_the_poles_endless(delay, factor):
    model = Model(demo_with(implementation="digital", delay_samples=delay))
    stiffer = {p.name: factor * p.value for p in model.parameters if p.name.startswith("K_s.")}
    found, seconds = answers(model.with_values(stiffer))
    assert found == [True, UnstableLoopError, UnstableLoopError]
    assert seconds < SOON


@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_transfer_functions_of_high_order_end(implementation):
    random = np.random.default_rng(0)
    controller = TransferFunctionController(
        implementation=implementation,
        numerator=random.normal(size=40).tolist(),
        denominator=np.poly(-random.uniform(0.1, 0.9, 40)).tolist(),
    )
    found, seconds = answers(Model(Rig.load(DATA / "rig.toml").replace(controller=controller)))
    assert found[1:] == [UnstableLoopError] * 2  # a gain of some amperes a metre holds no rotor
    assert seconds < SOON


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_coefficients_of_any_size_are_answered_or_refused(implementation, seed):
    random = np.random.default_rng(seed)
    widest = np.log10(MOST)

    def wild(*shape):
        return (10.0 ** random.uniform(-300, widest, shape) * random.choice([-1.0, 1.0], shape)).tolist()

    controller = StateSpaceController(
        implementation=implementation, A=wild(8, 8), B=wild(8, 1), C=wild(1, 8), D=wild(1, 1)
    )
    found, seconds = answers(Model(Rig.load(DATA / "rig.toml").replace(controller=controller)))
    assert all(answer is True or issubclass(answer, AmbidError) for answer in found)
    assert seconds < SOON


def test_coefficients_whose_products_would_be_infinite_are_told_by_name(golden):
    law = {"A": [[0.5, 0.0], [3e188, 0.5]], "B": [[1.0], [1.0]], "C": [[1.0, 1.0]], "D": [[0.0]]}
    with golden.raises(RigError):
        StateSpaceController(implementation="digital", **law)


def test_more_states_than_can_be_borne_are_refused(golden):
    random = np.random.default_rng(0)
    law = {"A": random.normal(size=(200, 200)), "B": np.ones((200, 1)), "C": np.ones((1, 200)), "D": [[0.0]]}
    controller = StateSpaceController(implementation="digital", delay_samples=10.5, **law)
    with golden.raises(ModelError):
        Model(Rig.load(DATA / "rig.toml").replace(controller=controller)).poles()
