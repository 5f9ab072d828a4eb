"""One thread for BLAS while we compute: on matrices of some thirty rows its threads only get in each other's way."""

from collections.abc import Callable, Sequence
from functools import cache, wraps
from threading import Lock
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


@cache
def _blas() -> Sequence[Any]:
    """The BLAS libraries of this process; they are all loaded when the first computation begins."""
    libraries: Sequence[Any] = ThreadpoolController().select(user_api="blas").lib_controllers
    return libraries


class _Limit:
    """One thread from the first computation that begins to the last that ends: the number is that of the process."""

    def __init__(self) -> None:
        self._lock, self._running = Lock(), 0
        self._before: list[int] = []

    def __enter__(self) -> None:
        with self._lock:
            if self._running == 0:
                self._before = [library.num_threads for library in _blas()]
                _set([1] * len(self._before))
            self._running += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._running -= 1
            if self._running == 0:
                _set(self._before)


_LIMIT = _Limit()


def _set(threads: Sequence[int]) -> None:
    for library, number in zip(_blas(), threads, strict=True):
        if hasattr(library, "clear_controlling_thread"):  # the last to end need not be the first that began
            library.clear_controlling_thread(force=True)
        library.set_num_threads(number)


def with_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function run with one BLAS thread; afterwards there are as many as before."""

    @wraps(function)
    def limited(*arguments: P.args, **options: P.kwargs) -> R:
        with _LIMIT:
            return function(*arguments, **options)

    return limited
