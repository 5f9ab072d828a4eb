"""One thread for BLAS while we compute: on matrices of some thirty rows its threads only get in each other's way."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ContextDecorator
from functools import cache
from threading import Lock
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

__all__ = ["with_one_blas_thread"]

P = ParamSpec("P")
R = TypeVar("R")


@cache
def _blas() -> ThreadpoolController:
    """The BLAS libraries of this process; they are all loaded when the first computation begins."""
    return ThreadpoolController()


class _OneThread(ContextDecorator):
    """One BLAS thread from the first computation that begins to the last that ends, whichever threads they run in."""

    def __init__(self) -> None:
        self._lock, self._running = Lock(), 0
        self._limit: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if self._running == 0:
                self._limit = _blas().limit(limits=1, user_api="blas")
            self._running += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._running -= 1
            if self._running == 0:
                self._limit.restore_original_limits()


_one_thread = _OneThread()


def with_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function run with one BLAS thread; afterwards there are as many as before."""
    return _one_thread(function)
