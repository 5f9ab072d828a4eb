"""BLAS has one thread while we compute, and what it had before afterwards, whichever threads compute."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from ambid.threads import with_one_blas_thread

BLAS = ThreadpoolController().select(user_api="blas")


def threads():
    return [library["num_threads"] for library in BLAS.info()]


@pytest.fixture
def two():
    if not BLAS.info():
        pytest.skip("NumPy's BLAS is none that threadpoolctl knows")
    with BLAS.limit(limits=2):
        yield threads()


def test_one_thread_inside_and_as_many_as_before_outside(two):
    assert set(with_one_blas_thread(threads)()) == {1}
    assert threads() == two


def test_an_error_gives_the_threads_back(two):
    with pytest.raises(ZeroDivisionError):
        with_one_blas_thread(lambda: 1 // 0)()
    assert threads() == two


def test_nested_calls(two):
    inner = with_one_blas_thread(threads)
    assert with_one_blas_thread(lambda: (inner(), threads()))() == ([1] * len(two), [1] * len(two))
    assert threads() == two


def test_threads_that_compute_side_by_side_give_back_what_there_was():
    before, together = threads(), Barrier(4)

    @with_one_blas_thread
    def compute(seed):
        np.linalg.qr(np.random.default_rng(seed).standard_normal((50, 50)))
        together.wait()
        found = threads()
        together.wait()
        return found

    with ThreadPoolExecutor(4) as pool:
        inside = list(pool.map(compute, range(4)))
    assert inside == [[1] * len(before)] * 4
    assert threads() == before
