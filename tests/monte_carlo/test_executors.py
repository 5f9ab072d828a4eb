"""Executors of all kinds: the rows do not depend on who makes them, nor on the order in which they come."""

import pickle
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import pytest

import ambid
from ambid.errors import IdentificationError, InputError
from ambid.monte_carlo import executors, procedure, run_monte_carlo
from monte_carlo.planned import CHUNK, RUNS, content, plan


@pytest.fixture(autouse=True)
def _small_tasks(monkeypatch):
    monkeypatch.setattr(procedure, "CHUNK", CHUNK)
    monkeypatch.setattr(procedure, "BATCH", 2)
    monkeypatch.setattr(executors, "HELD", {})


class Wire(ThreadPoolExecutor):
    """Pickles what is submitted, as an executor of processes does."""

    def __init__(self):
        super().__init__(1)
        self.sizes = []

    def submit(self, *work):
        packed = pickle.dumps(work)
        self.sizes.append(len(packed))
        function, *given = pickle.loads(packed)
        return super().submit(function, *given)


class Maps:
    """Has no more than a map."""

    def map(self, work, tasks):
        return map(work, tasks)


class LastFirst:
    """Makes nothing until somebody waits, and then the last task first."""

    def __init__(self):
        self.waiting = []

    def submit(self, work, *given):
        future = Future()
        if len(given) == 1:
            future.set_result(work(*given))
            return future
        self.waiting.append((future, work, given))
        if len(self.waiting) == 5:  # 4 + 4 + 1 runs, two in a task, but for the last of all
            for future_, own, arguments in reversed(self.waiting):
                future_.set_result(own(*arguments))
        return future


@pytest.mark.parametrize("kind", [lambda: ThreadPoolExecutor(2), Maps])
def test_the_same_rows(kind, whole):
    assert run_monte_carlo(plan(), RUNS, executor=kind()).rows == whole.rows


def test_rows_and_parts_are_the_same_in_any_order(whole, tmp_path):
    folder = tmp_path / "runs.parquet"
    assert run_monte_carlo(plan(), RUNS, out=folder, executor=LastFirst()).rows == whole.rows
    assert len(whole.parts) == 4
    assert content(folder) == whole.parts


def test_a_plan_that_is_held_is_not_sent_again(whole):
    own, size = plan(), len(pickle.dumps(plan()))
    with Wire() as executor:
        assert run_monte_carlo(own, RUNS, executor=executor).rows == whole.rows
    assert sum(executor.sizes) > 5 * size
    ambid.hold_plan(own)
    with Wire() as executor:
        assert run_monte_carlo(own, RUNS, executor=executor).rows == whole.rows
    assert len(executor.sizes) == 6
    assert sum(executor.sizes) < size


@pytest.mark.slow
def test_processes_that_hold_the_plan(whole):
    own = plan()
    with ProcessPoolExecutor(2, get_context("spawn"), ambid.hold_plan, (own,)) as executor:
        assert executor.submit(executors.holds_plan, own.key).result()
        assert run_monte_carlo(own, RUNS, executor=executor).rows == whole.rows


def test_another_plan_has_another_key():
    assert plan().key == plan().key != plan(seed=5).key


def test_diagnoses_are_a_task_each():
    with Wire() as executor:
        run_monte_carlo(plan(diagnose=True), 2, executor=executor)
    assert len(executor.sizes) == 3


def test_a_worker_of_another_version(monkeypatch, golden):
    versions = iter(["0.0.7", "0.0.8"])
    monkeypatch.setattr(executors, "version", lambda package: next(versions))
    with golden.raises(InputError):
        run_monte_carlo(plan(), 1, executor=Maps())


def test_no_executor(golden):
    with golden.raises(InputError):
        run_monte_carlo(plan(), 1, executor="tcp://host:8786")


def test_what_came_out_of_order_before_a_worker_was_gone(tmp_path, golden):
    from concurrent.futures import BrokenExecutor

    class Breaks:
        def map(self, work, tasks):
            yield work(tasks[0])
            yield work(tasks[2])  # of the next chunk, whose first runs these are
            yield work(tasks[4])
            raise BrokenExecutor("gone")

    folder = tmp_path / "runs.parquet"
    with golden.raises(IdentificationError):
        run_monte_carlo(plan(), RUNS, out=folder, executor=Breaks())
    made = []
    run_monte_carlo(plan(), RUNS, out=folder, progress=lambda done, total: made.append(total))
    assert made[0] == 4
