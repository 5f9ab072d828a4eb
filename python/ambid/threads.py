"""One thread for BLAS while we compute: on matrices of some thirty rows its threads only get in each other's way."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

__all__ = ["with_one_blas_thread"]

P = ParamSpec("P")
R = TypeVar("R")


@cache
def _blas() -> ThreadpoolController:
    """The BLAS libraries of this process; they are all loaded when the first computation begins."""
    return ThreadpoolController().select(user_api="blas")


def with_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function run with one BLAS thread; afterwards there are as many as before.

    The number is that of the process: where several threads compute, the first to begin sets it, and gives it back
    when it ends.
    """

    @wraps(function)
    def limited(*arguments: P.args, **options: P.kwargs) -> R:
        with _blas().limit(limits=1):
            return function(*arguments, **options)

    return limited
