"""Which variations of a claim are in the fast tier: the first few; the others are run in the slow one."""

from collections.abc import Iterable
from typing import Any

import pytest

__all__ = ["first_fast"]


def first_fast(values: Iterable[Any], fast: int = 1) -> list[Any]:
    """Values of a parameter, all but the first few of which are slow; a tuple is one of several parameters."""
    own = [value if isinstance(value, tuple) else (value,) for value in values]
    return [pytest.param(*each, marks=[] if k < fast else [pytest.mark.slow]) for k, each in enumerate(own)]
