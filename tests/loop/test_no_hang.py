"""Loops whose poles are hard to come by: an answer or an error, and no hang."""

import json
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

from ambid import Model, Rig
from ambid.demo import DATA
from ambid.errors import AmbidError, ModelError, RigError
from ambid.rig.controller import StateSpaceController, TransferFunctionController
from ambid.rig.fields import LARGEST_VALUE
from ambid.threads import with_one_blas_thread

HANGS = 300.0
"""Seconds after which the child is taken to hang; all of it takes one or two, or for ever."""
UNDER_WAY = {
    f"{delay} samples late, {factor:.2f} as stiff": (delay, factor)
    for delay, factor in [(15.0, 1.25), (16.0, 1.25), (17.0, 1.25), (18.0, 1.25), (20.0, 1.25), (40.0, 1.25)]
    + [(15.5, 1.4378941112243542)]
}
IMPLEMENTATIONS = ("analog", "digital")


def demo_with(controller) -> Model:
    return Model(Rig.load(DATA / "rig.toml").replace(controller=controller))


def with_commands_under_way(delay: float, factor: float) -> Model:
    late = {"implementation": "digital", "delay_samples": delay}
    model = demo_with(Rig.load(DATA / "rig.toml").controller.model_copy(update=late))
    return model.with_values({p.name: factor * p.value for p in model.parameters if p.name.startswith("K_s.")})


def of_high_order(implementation: str) -> Model:
    random = np.random.default_rng(0)
    numerator, poles = random.normal(size=40).tolist(), -random.uniform(0.1, 0.9, 40)
    own = {"numerator": numerator, "denominator": np.poly(poles).tolist()}
    return demo_with(TransferFunctionController(implementation=implementation, **own))


def of_any_size(implementation: str, seed: int) -> Model:
    random = np.random.default_rng(seed)
    widest = np.log10(LARGEST_VALUE)

    def wild(*shape: int) -> list:
        return (10.0 ** random.uniform(-300, widest, shape) * random.choice([-1.0, 1.0], shape)).tolist()

    law = {"A": wild(8, 8), "B": wild(8, 1), "C": wild(1, 8), "D": wild(1, 1)}
    return demo_with(StateSpaceController(implementation=implementation, **law))


@with_one_blas_thread
def answers(make: Callable[[], Model]) -> list[bool | str]:
    """What the loop answers or raises, one word a question."""
    model, points = make(), np.exp(1j * np.linspace(0.1, 3.0, 20))
    questions = (
        model.poles,
        lambda: model.loop.transfer(model.theta, points),
        lambda: model.loop.simulate(model.theta, np.zeros((50, len(model.loop.inputs)))),
    )
    found: list[bool | str] = []
    for question in questions:
        try:
            answer = question()
            found.append(bool((np.isfinite(answer) | (answer == -np.inf)).all()))  # -inf: gone within a sample
        except AmbidError as error:
            found.append(type(error).__name__)
    return found


LOOPS: dict[str, Callable[[], Model]] = (
    {name: lambda own=own: with_commands_under_way(*own) for name, own in UNDER_WAY.items()}
    | {f"high order, {own}": lambda own=own: of_high_order(own) for own in IMPLEMENTATIONS}
    | {f"any size, {own}, {k}": lambda own=own, k=k: of_any_size(own, k) for own in IMPLEMENTATIONS for k in range(4)}
)


@pytest.fixture(scope="module")
def found() -> dict[str, list[bool | str]]:
    """The answers of all loops, from a child that is ended where it hangs."""
    child = subprocess.run([sys.executable, __file__], capture_output=True, text=True, timeout=HANGS)
    assert child.returncode == 0, child.stderr
    return json.loads(child.stdout)


@pytest.mark.parametrize("name", UNDER_WAY)
def test_commands_under_way_do_not_make_the_poles_endless(found, name):
    assert found[name] == [True, "UnstableLoopError", "UnstableLoopError"]


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_transfer_functions_of_high_order_end(found, implementation):
    """A gain of some amperes a metre holds no rotor."""
    assert found[f"high order, {implementation}"][1:] == ["UnstableLoopError"] * 2


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_coefficients_of_any_size_are_answered_or_refused(found, implementation, seed):
    """An error is one of the package: another one ends the child."""
    assert False not in found[f"any size, {implementation}, {seed}"]


def test_coefficients_whose_products_would_be_infinite_are_told_by_name(golden):
    law = {"A": [[0.5, 0.0], [3e188, 0.5]], "B": [[1.0], [1.0]], "C": [[1.0, 1.0]], "D": [[0.0]]}
    with golden.raises(RigError):
        StateSpaceController(implementation="digital", **law)


def test_more_states_than_can_be_borne_are_refused(golden):
    random = np.random.default_rng(0)
    law = {"A": random.normal(size=(200, 200)), "B": np.ones((200, 1)), "C": np.ones((1, 200)), "D": [[0.0]]}
    with golden.raises(ModelError):
        demo_with(StateSpaceController(implementation="digital", delay_samples=10.5, **law)).poles()


if __name__ == "__main__":
    print(json.dumps({name: answers(make) for name, make in LOOPS.items()}))
